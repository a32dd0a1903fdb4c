//! What the edge lengths of a mesh determine: areas, angles, cotangents, lumped mass.

use std::f64::consts::PI;

use super::topology::Topology;
use crate::error::{Error, Result};

/// Lengths, areas and angles of the faces, and their sums at the vertices.
///
/// They are taken from the positions of the corners: from the three lengths alone the area of a
/// needle would keep half of its digits.
#[derive(Debug)]
pub(super) struct Geometry {
    pub(super) areas: Vec<f64>,
    pub(super) diameters: Vec<f64>,
    pub(super) half_cotangents: Vec<[f64; 3]>,
    pub(super) mass: Vec<f64>,
    pub(super) angle_defects: Vec<f64>,
}

impl Geometry {
    /// Measures the faces. One is degenerate where twice its area is at most `degenerate` times its
    /// longest edge squared.
    pub(super) fn new(vertices: &[[f64; 3]], topology: &Topology, degenerate: f64) -> Result<Self> {
        let faces = &topology.faces;
        let m = faces.len();
        let mut geometry = Self {
            areas: Vec::with_capacity(m),
            diameters: Vec::with_capacity(m),
            half_cotangents: Vec::with_capacity(m),
            mass: vec![0.0; vertices.len()],
            angle_defects: topology
                .on_boundary
                .iter()
                .map(|&boundary| if boundary { PI } else { 2.0 * PI })
                .collect(),
        };
        for (face, corners) in faces.iter().enumerate() {
            let p = corners.map(|v| vertices[v as usize]);
            let (double_area, diameter) = extent(p);
            if !has_area(double_area, diameter, degenerate) {
                return Err(Error::DegenerateFace {
                    face,
                    vertices: *corners,
                    area: 0.5 * double_area,
                    diameter,
                });
            }
            let cosine = [0, 1, 2].map(|k: usize| {
                let apex = p[k];
                dot(
                    subtract(p[(k + 1) % 3], apex),
                    subtract(p[(k + 2) % 3], apex),
                )
            });
            let area = 0.5 * double_area;
            geometry.areas.push(area);
            geometry.diameters.push(diameter);
            geometry
                .half_cotangents
                .push([0, 1, 2].map(|k: usize| 0.5 * cosine[(k + 2) % 3] / double_area));
            for (&v, cosine) in corners.iter().zip(cosine) {
                geometry.mass[v as usize] += area / 3.0;
                geometry.angle_defects[v as usize] -= double_area.atan2(cosine);
            }
        }
        Ok(geometry)
    }
}

/// Twice the area of a triangle, and its longest edge.
fn extent(p: [[f64; 3]; 3]) -> (f64, f64) {
    let normal = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
    let diameter = (0..3)
        .map(|k| distance(p[k], p[(k + 1) % 3]))
        .fold(0.0, f64::max);
    (dot(normal, normal).sqrt(), diameter)
}

/// Whether an area is one beside the longest edge. Huge coordinates overflow to infinity or NaN.
fn has_area(double_area: f64, diameter: f64, degenerate: f64) -> bool {
    double_area > degenerate * diameter * diameter && double_area.is_finite()
}

/// Whether a mesh takes a triangle: twice its area is more than `degenerate` times its longest edge
/// squared.
pub(crate) fn is_face(p: [[f64; 3]; 3], degenerate: f64) -> bool {
    let (double_area, diameter) = extent(p);
    has_area(double_area, diameter, degenerate)
}

pub(crate) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = subtract(a, b);
    dot(d, d).sqrt()
}

pub(crate) fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
