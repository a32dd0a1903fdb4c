//! A connected set of faces opened to a disk, by half-edges of the surface: nothing is copied.

use super::cut::cut_to_disk;
use super::geometry::{Geometry, next};
use super::marks::{Marks, walk_fan};
use crate::mesh::NONE;

/// Cosine of the angle between normals below which faces do not lie in one plane.
const COPLANAR: f64 = 1.0 - 1e-14;

/// A chart as a disk: its inner vertices, and its boundary loop with what lies around it.
#[derive(Debug)]
pub(super) struct Disk {
    /// Surface vertices with all faces in the chart and off the cut, in order; their places here are
    /// in the marks.
    pub inner: Vec<u32>,
    /// The half-edges of the boundary in order, the chart on their left.
    pub boundary: Vec<u32>,
    /// The half-edges that start at the vertex where `boundary[i]` starts, in its one fan of faces:
    /// `fans[fan_starts[i]..fan_starts[i + 1]]`, `boundary[i]` last.
    pub fans: Vec<u32>,
    pub fan_starts: Vec<usize>,
    pub shape: Shape,
}

/// Figures of a chart that need no solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Euler characteristic before the cut.
    pub euler_characteristic: i64,
    /// Length of the cut.
    pub cut: f64,
    /// Length of the boundary, without that of the surface.
    pub perimeter: f64,
}

/// What comes of opening a chart.
#[derive(Debug)]
pub(super) enum Opened {
    Disk(Disk),
    /// The faces lie in one plane with holes: flat as they are.
    Planar(Shape),
    /// A closed surface of so few faces that a cut does not open it.
    Closed(Shape),
}

impl Disk {
    /// Opens the chart of the given faces, which are sorted and connected.
    pub fn open(geometry: &Geometry, faces: &[u32], marks: &mut Marks) -> Opened {
        marks.place(geometry, faces);
        let mut met: Vec<u32> = Vec::with_capacity(faces.len() / 2 + 16);
        let (mut n_boundary, mut perimeter) = (0, 0.0);
        for &f in faces {
            for h in 3 * f as usize..3 * f as usize + 3 {
                let v = geometry.origins[h];
                if marks.meet_vertex(v as usize) {
                    met.push(v);
                }
                let across = geometry.across(h);
                if across.is_none_or(|g| marks.face(g).is_none()) {
                    n_boundary += 1;
                    if across.is_some() {
                        perimeter += geometry.costs[h];
                    }
                    marks.set_vertex(v as usize, NONE);
                    marks.set_vertex(geometry.origins[next(h)] as usize, NONE);
                }
            }
        }
        let mut inner = met;
        inner.retain(|&v| marks.vertex(v as usize).is_some());
        // A fan at the boundary has one half-edge out, so that there are as many of both.
        let euler = |inner: usize, boundary: usize| {
            inner as i64 - (faces.len() as i64 - boundary as i64) / 2
        };
        let mut shape = Shape {
            euler_characteristic: euler(inner.len(), n_boundary),
            cut: 0.0,
            perimeter,
        };
        let mut cut = Vec::new();
        if shape.euler_characteristic != 1 {
            if n_boundary > 0 && planar(geometry, faces) {
                return Opened::Planar(shape);
            }
            place(&mut inner, marks);
            let opening = cut_to_disk(geometry, faces, &inner, marks);
            (cut, shape.cut) = (opening.half_edges, opening.length / geometry.unit);
            for (i, _) in cut.iter().enumerate().filter(|(_, is_cut)| **is_cut) {
                n_boundary += 1;
                marks.set_vertex(
                    geometry.origins[3 * faces[i / 3] as usize + i % 3] as usize,
                    NONE,
                );
            }
            inner.retain(|&v| marks.vertex(v as usize).is_some());
            if euler(inner.len(), n_boundary) != 1 {
                return Opened::Closed(shape);
            }
        }
        place(&mut inner, marks);

        let is_boundary = |h: usize| match geometry.across(h) {
            Some(g) if marks.face(g).is_some() => {
                !cut.is_empty() && marks.face(h / 3).is_some_and(|i| cut[3 * i + h % 3])
            }
            _ => true,
        };
        let start = faces
            .iter()
            .flat_map(|&f| 3 * f as usize..3 * f as usize + 3)
            .find(|&h| is_boundary(h));
        let mut disk = Self {
            inner,
            boundary: Vec::with_capacity(n_boundary),
            fans: Vec::with_capacity(4 * n_boundary),
            fan_starts: vec![0],
            shape,
        };
        if let Some(start) = start {
            let mut h = start;
            loop {
                h = walk_fan(geometry, h, &is_boundary, &mut disk.fans);
                disk.fan_starts.push(disk.fans.len());
                disk.boundary.push(h as u32);
                if h == start || disk.boundary.len() > n_boundary {
                    break;
                }
            }
        }
        if disk.boundary.len() == n_boundary {
            Opened::Disk(disk)
        } else {
            Opened::Closed(shape)
        }
    }
}

impl Disk {
    /// Marks the faces and inner vertices with their places, as opening does.
    pub fn mark(&self, geometry: &Geometry, faces: &[u32], marks: &mut Marks) {
        marks.place(geometry, faces);
        mark_inner(&self.inner, marks);
    }
}

fn place(inner: &mut [u32], marks: &mut Marks) {
    inner.sort_unstable();
    mark_inner(inner, marks);
}

fn mark_inner(inner: &[u32], marks: &mut Marks) {
    for (i, &v) in (0..).zip(inner) {
        marks.set_vertex(v as usize, i);
    }
}

fn planar(geometry: &Geometry, faces: &[u32]) -> bool {
    let first = geometry.normals[faces[0] as usize];
    faces
        .iter()
        .all(|&f| super::geometry::dot(geometry.normals[f as usize], first) > COPLANAR)
}
