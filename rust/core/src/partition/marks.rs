//! Marks of faces and vertices, the fan around a boundary vertex, and unions of sorted faces.

use super::geometry::{Geometry, next};
use crate::mesh::NONE;

/// Marks of some faces and vertices in arrays of the whole surface, which are never
/// cleared: a mark counts where its stamp is the current one.
#[derive(Debug, Default)]
pub(super) struct Marks {
    stamp: u32,
    faces: Vec<(u32, u32)>,
    vertices: Vec<(u32, u32)>,
}

impl Marks {
    /// Marks the faces with their places in the list, and no vertex.
    pub fn place(&mut self, geometry: &Geometry, faces: &[u32]) {
        self.restart(geometry);
        for (i, &f) in (0..).zip(faces) {
            self.set_face(f as usize, i);
        }
    }

    pub fn restart(&mut self, geometry: &Geometry) {
        self.faces.resize(geometry.n_faces(), (0, 0));
        self.vertices.resize(geometry.n_vertices(), (0, 0));
        self.stamp = if let Some(stamp) = self.stamp.checked_add(1) {
            stamp
        } else {
            self.faces.fill((0, 0));
            self.vertices.fill((0, 0));
            1
        };
    }

    pub fn set_face(&mut self, f: usize, value: u32) {
        self.faces[f] = (self.stamp, value);
    }

    /// Place of a face in the chart.
    #[inline]
    pub fn face(&self, f: usize) -> Option<usize> {
        let (stamp, value) = self.faces[f];
        (stamp == self.stamp).then_some(value as usize)
    }

    pub fn set_vertex(&mut self, v: usize, value: u32) {
        self.vertices[v] = (self.stamp, value);
    }

    /// Whether the vertex has not been marked before; it is now.
    #[inline]
    pub fn meet_vertex(&mut self, v: usize) -> bool {
        let fresh = self.vertices[v].0 != self.stamp;
        if fresh {
            self.set_vertex(v, 0);
        }
        fresh
    }

    #[inline]
    pub fn vertex(&self, v: usize) -> Option<usize> {
        let (stamp, value) = self.vertices[v];
        (stamp == self.stamp && value != NONE).then_some(value as usize)
    }
}

/// Turns about the end of boundary half-edge `h`; returns the boundary half-edge that leaves it.
pub(super) fn walk_fan(
    geometry: &Geometry,
    h: usize,
    is_boundary: &impl Fn(usize) -> bool,
    fan: &mut Vec<u32>,
) -> usize {
    let mut h = next(h);
    fan.push(h as u32);
    while !is_boundary(h) {
        h = next(geometry.twins[h] as usize);
        fan.push(h as u32);
    }
    h
}

/// Sorted union of two sorted lists without common faces.
pub(super) fn union(a: &[u32], b: &[u32]) -> Vec<u32> {
    let mut faces = Vec::with_capacity(a.len() + b.len());
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i] < b[j] {
            faces.push(a[i]);
            i += 1;
        } else {
            faces.push(b[j]);
            j += 1;
        }
    }
    faces.extend_from_slice(&a[i..]);
    faces.extend_from_slice(&b[j..]);
    faces
}
