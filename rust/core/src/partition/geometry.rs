//! What the partition asks of a surface, per half-edge, on a copy of unit area.

use std::collections::HashMap;

use petgraph::unionfind::UnionFind;

use crate::error::Result;
use crate::linear::Ordering;
use crate::mesh::{Adjacency, FORBIDDEN, NONE, TriangleMesh, distance};
use crate::operators::{DirichletSystem, Stiffness};
use crate::surface::Surface;

/// Faces above which the order of elimination is the one that is found soonest.
const FINE: usize = 200_000;

/// A surface scaled to unit area. Half-edge `3 f + k` runs from corner `k` of face `f` to the next.
/// Vertices are numbered by an elimination order of little fill. The order stays good on any subset,
/// as its fill there is a subset of that of the whole.
#[derive(Debug)]
pub(super) struct Geometry {
    /// Length on the surface of one unit here: the root of its area.
    pub unit: f64,
    /// The vertex that each half-edge starts at.
    pub origins: Vec<u32>,
    /// The half-edge on the other side; [`NONE`] at the border of the surface.
    pub twins: Vec<u32>,
    pub lengths: Vec<f64>,
    /// What a seam along each half-edge costs: its length, times a factor where the surface has some.
    pub costs: Vec<f64>,
    /// The same in the units of the surface, by which equally long ways compare as they do elsewhere.
    pub surface_costs: Vec<f64>,
    /// A face that stands for those that no seam may separate; empty where seams may run anywhere.
    pub groups: Vec<u32>,
    /// Angle at the corner that the half-edge starts at.
    pub angles: Vec<f64>,
    /// Half the cotangent of the angle opposite to the half-edge, in its own face.
    pub half_cotangents: Vec<f64>,
    /// Stiffness entry of the edge.
    pub stiffness: Vec<f64>,
    pub positions: Vec<[f64; 3]>,
    pub areas: Vec<f64>,
    pub normals: Vec<[f64; 3]>,
    pub centroids: Vec<[f64; 3]>,
    pub mean_edge_length: f64,
    pub vertices: Vertices,
}

/// What the equations inside a chart need of the vertices, surface vertices inside a chart having
/// all of their faces in it.
#[derive(Debug)]
pub(super) struct Vertices {
    pub masses: Vec<f64>,
    /// Integrated curvature.
    pub defects: Vec<f64>,
    /// Diagonal of the stiffness matrix.
    pub diagonal: Vec<f64>,
    /// Neighbours of each vertex that come before it, in order.
    pub row_starts: Vec<usize>,
    pub columns: Vec<u32>,
    /// Off-diagonal stiffness in the order of `columns`.
    pub values: Vec<f64>,
}

impl Geometry {
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(surface: &Surface) -> Result<Self> {
        let mesh = surface.mesh();
        let (n, m) = (mesh.n_vertices(), mesh.n_faces());
        let unit = mesh.area().sqrt();
        let positions: Vec<[f64; 3]> = mesh
            .vertices()
            .iter()
            .map(|p| p.map(|x| x / unit))
            .collect();
        let stiffness = Stiffness::new(mesh);
        let mut twins = vec![NONE; 3 * m];
        let mut edge_stiffness = vec![0.0; 3 * m];
        for (sides, &value) in mesh.edge_half_edges().iter().zip(stiffness.edge_values()) {
            edge_stiffness[sides[0] as usize] = value;
            if sides[1] != NONE {
                edge_stiffness[sides[1] as usize] = value;
                twins[sides[0] as usize] = sides[1];
                twins[sides[1] as usize] = sides[0];
            }
        }
        let mut surface_lengths = Vec::with_capacity(3 * m);
        let mut angles = Vec::with_capacity(3 * m);
        let (mut normals, mut centroids) = (Vec::with_capacity(m), Vec::with_capacity(m));
        for face in mesh.faces() {
            let p = face.map(|v| positions[v as usize]);
            for k in 0..3 {
                let (to, from) = (
                    subtract(p[(k + 1) % 3], p[k]),
                    subtract(p[(k + 2) % 3], p[k]),
                );
                surface_lengths.push(distance(
                    mesh.vertices()[face[k] as usize],
                    mesh.vertices()[face[(k + 1) % 3] as usize],
                ));
                angles.push(norm(cross(to, from)).atan2(dot(to, from)));
            }
            let normal = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
            let length = norm(normal);
            normals.push(normal.map(|x| x / length));
            centroids.push([0, 1, 2].map(|axis| (p[0][axis] + p[1][axis] + p[2][axis]) / 3.0));
        }
        let (surface_costs, groups) = seam_costs(mesh, &surface_lengths);
        let adjacency = mesh.adjacency();
        // So fine a surface gets charts that have been found on a simpler one: few factors are made.
        let symbolic = if mesh.n_faces() > FINE {
            DirichletSystem::new(mesh, Ordering::MinimumDegree)?.symbolic()
        } else {
            surface.dirichlet_system()?.symbolic()
        };
        let order = symbolic.order();
        let mut ranks = vec![0_u32; n];
        for (rank, &v) in (0..).zip(order) {
            ranks[v as usize] = rank;
        }
        let ordered = |values: &[f64]| order.iter().map(|&v| values[v as usize]).collect();
        let diagonal: Vec<f64> = (0..n).map(|v| stiffness.diagonal(adjacency, v)).collect();
        let masses: Vec<f64> = mesh.mass().iter().map(|a| a / (unit * unit)).collect();
        let (row_starts, columns, values) = earlier(adjacency, &stiffness, order, &ranks);
        Ok(Self {
            unit,
            origins: mesh
                .faces()
                .as_flattened()
                .iter()
                .map(|&v| ranks[v as usize])
                .collect(),
            twins,
            lengths: surface_lengths.iter().map(|length| length / unit).collect(),
            costs: surface_costs.iter().map(|cost| cost / unit).collect(),
            surface_costs,
            groups,
            angles,
            half_cotangents: mesh.half_cotangents().as_flattened().to_vec(),
            stiffness: edge_stiffness,
            positions: order.iter().map(|&v| positions[v as usize]).collect(),
            areas: mesh.areas().iter().map(|a| a / (unit * unit)).collect(),
            normals,
            centroids,
            mean_edge_length: mesh.mean_edge_length() / unit,
            vertices: Vertices {
                masses: ordered(&masses),
                defects: ordered(mesh.angle_defects()),
                diagonal: ordered(&diagonal),
                row_starts,
                columns,
                values,
            },
        })
    }

    /// Gives all faces that no seam may separate the label of the first of them in the list.
    pub fn unite(&self, faces: &[u32], labels: &mut [u32]) {
        if self.groups.is_empty() {
            return;
        }
        let mut of_group = HashMap::new();
        for (&f, label) in faces.iter().zip(labels) {
            *label = *of_group.entry(self.groups[f as usize]).or_insert(*label);
        }
    }

    pub fn n_faces(&self) -> usize {
        self.areas.len()
    }

    pub fn n_vertices(&self) -> usize {
        self.positions.len()
    }

    /// The face across half-edge `h`.
    #[inline]
    pub fn across(&self, h: usize) -> Option<usize> {
        let twin = self.twins[h];
        (twin != NONE).then_some(twin as usize / 3)
    }

    /// The faces across the three edges of `f`, each with its half-edge in `f`.
    #[inline]
    pub fn around(&self, f: usize) -> impl Iterator<Item = (usize, usize)> {
        (3 * f..3 * f + 3).filter_map(|h| self.across(h).map(|g| (h, g)))
    }

    pub fn area_of(&self, faces: &[u32]) -> f64 {
        faces.iter().map(|&f| self.areas[f as usize]).sum()
    }
}

/// The neighbours of each vertex that come before it in the order, row by row: where the rows start,
/// the columns, and the stiffness there.
fn earlier(
    adjacency: &Adjacency,
    stiffness: &Stiffness,
    order: &[u32],
    ranks: &[u32],
) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let mut row_starts = vec![0];
    let (mut columns, mut values) = (Vec::new(), Vec::new());
    let mut row: Vec<(u32, f64)> = Vec::new();
    for (rank, &v) in (0..).zip(order) {
        let entries = adjacency.starts()[v as usize]..adjacency.starts()[v as usize + 1];
        row.clear();
        row.extend(
            entries
                .map(|e| {
                    (
                        ranks[adjacency.vertices()[e] as usize],
                        stiffness.values()[e],
                    )
                })
                .filter(|entry| entry.0 < rank),
        );
        row.sort_unstable_by_key(|entry| entry.0);
        columns.extend(row.iter().map(|entry| entry.0));
        values.extend(row.iter().map(|entry| entry.1));
        row_starts.push(columns.len());
    }
    (row_starts, columns, values)
}

/// What seams along the half-edges cost, and the groups of faces that no seam may separate.
fn seam_costs(mesh: &TriangleMesh, lengths: &[f64]) -> (Vec<f64>, Vec<u32>) {
    let Some(factors) = mesh.seam_costs() else {
        return (lengths.to_vec(), Vec::new());
    };
    let factors = factors.as_flattened();
    let costs = factors
        .iter()
        .zip(lengths)
        .map(|(factor, length)| factor.min(FORBIDDEN) * length)
        .collect();
    let mut joined = UnionFind::<u32>::new(mesh.n_faces());
    let mut any = false;
    for &[h, opposite] in mesh.edge_half_edges() {
        if opposite != NONE && factors[h as usize].is_infinite() {
            joined.union(h / 3, opposite / 3);
            any = true;
        }
    }
    let groups = any.then(|| joined.into_labeling());
    (costs, groups.unwrap_or_default())
}

/// The half-edge after `h` in its face.
#[inline]
pub(super) fn next(h: usize) -> usize {
    h - h % 3 + (h + 1) % 3
}

pub(super) fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
