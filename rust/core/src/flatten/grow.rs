//! A chart with faces around it that are attached to its boundary.

use std::collections::VecDeque;

use super::chart::{ChartMesh, check_faces};
use crate::error::Result;
use crate::mesh::{NONE, TriangleMesh};

/// A chart and faces around it, of the same topology as the chart.
#[derive(Debug)]
pub struct Grown {
    /// Both; the vertices of the chart come first, in their order, and so do its faces.
    pub mesh: TriangleMesh,
    /// The surface vertex of each vertex.
    pub vertices: Vec<u32>,
    /// The surface face of each face.
    pub faces: Vec<i64>,
}

/// Attaches faces to a chart, the nearest ones first, each across one edge.
///
/// Sides that come to lie beside each other are joined, but not where that joined two vertices of
/// the chart: it stays cut as it is. `chart_faces` are the surface faces of the chart, `around`
/// those to attach; what does not connect to the chart is left out.
///
/// # Errors
/// [`crate::Error::Topology`] for faces that are not of the surface, those of
/// [`TriangleMesh::accepted`].
pub fn grow(
    surface: &TriangleMesh,
    chart: &ChartMesh,
    chart_faces: &[i64],
    around: &[i64],
) -> Result<Grown> {
    check_faces("around", surface, around)?;
    let mut rim = Rim::new(surface, chart, chart_faces, around);
    while let Some(h) = rim.queue.pop_front() {
        rim.attach(h);
    }
    rim.finish()
}

/// The domain as it grows. Its half-edges, three a face, are numbered as those of a mesh.
struct Rim<'a> {
    surface: &'a TriangleMesh,
    faces: Vec<i64>,
    /// Corners of the faces; several numbers may have become one vertex.
    corners: Vec<u32>,
    /// The surface vertex of each number.
    vertices: Vec<u32>,
    /// The number that each number has become, itself or a lower one.
    joined: Vec<u32>,
    n_chart: usize,
    wanted: Vec<bool>,
    /// Half-edges before and after each one along the boundary; [`NONE`] inside.
    before: Vec<u32>,
    after: Vec<u32>,
    queue: VecDeque<u32>,
}

impl<'a> Rim<'a> {
    fn new(
        surface: &'a TriangleMesh,
        chart: &ChartMesh,
        chart_faces: &[i64],
        around: &[i64],
    ) -> Self {
        let mesh = &chart.mesh;
        let mut wanted = vec![false; surface.n_faces()];
        for &f in around {
            wanted[f as usize] = true;
        }
        for &f in chart_faces {
            wanted[f as usize] = false;
        }
        let n = 3 * mesh.n_faces();
        let mut rim = Self {
            surface,
            faces: chart_faces.to_vec(),
            corners: mesh.faces().as_flattened().to_vec(),
            vertices: chart.vertices.clone(),
            joined: (0..mesh.n_vertices() as u32).collect(),
            n_chart: mesh.n_vertices(),
            wanted,
            before: vec![NONE; n],
            after: vec![NONE; n],
            queue: VecDeque::new(),
        };
        let mut leaving = vec![NONE; mesh.n_vertices()];
        let open = || {
            mesh.edge_half_edges()
                .iter()
                .filter(|half_edges| half_edges[1] == NONE)
                .map(|half_edges| half_edges[0])
        };
        for h in open() {
            leaving[mesh.half_edge_ends(h)[0] as usize] = h;
        }
        for h in open() {
            rim.link(h, leaving[mesh.half_edge_ends(h)[1] as usize]);
        }
        // In an order that does not depend on the numbers of the edges.
        let mut sides: Vec<u32> = open().collect();
        sides.sort_unstable();
        rim.queue.extend(sides);
        rim
    }

    fn link(&mut self, h: u32, next: u32) {
        self.after[h as usize] = next;
        self.before[next as usize] = h;
    }

    fn origin(&self, h: u32) -> u32 {
        self.number(self.corners[h as usize])
    }

    fn number(&self, mut v: u32) -> u32 {
        while self.joined[v as usize] != v {
            v = self.joined[v as usize];
        }
        v
    }

    fn end(&self, h: u32) -> u32 {
        self.origin(h - h % 3 + (h + 1) % 3)
    }

    /// The half-edge of the surface that `h` is.
    fn on_surface(&self, h: u32) -> usize {
        3 * self.faces[h as usize / 3] as usize + h as usize % 3
    }

    /// The half-edge of the surface on the other side of `h`.
    fn twin(&self, h: u32) -> Option<usize> {
        let here = self.on_surface(h);
        let across = self.surface.neighbours()[here / 3][here % 3];
        if across == NONE {
            return None;
        }
        let [start, end] = self.surface.half_edge_ends(here as u32);
        let other = 3 * across as usize;
        (other..other + 3).find(|&g| self.surface.half_edge_ends(g as u32) == [end, start])
    }

    /// Attaches the face across a side of the boundary, if it is wanted.
    fn attach(&mut self, h: u32) {
        if self.after[h as usize] == NONE {
            return;
        }
        let Some(twin) = self.twin(h) else { return };
        let face = twin / 3;
        if !std::mem::replace(&mut self.wanted[face], false) {
            return;
        }
        let apex = self.vertices.len() as u32;
        self.vertices
            .push(self.surface.faces()[face][(twin + 2) % 3]);
        self.joined.push(apex);
        let first = self.corners.len() as u32;
        let k = (twin % 3) as u32;
        let (start, end) = (self.origin(h), self.end(h));
        self.faces.push(face as i64);
        self.corners.extend([0; 3]);
        self.corners[(first + k) as usize] = end;
        self.corners[(first + (k + 1) % 3) as usize] = start;
        self.corners[(first + (k + 2) % 3) as usize] = apex;
        self.before.extend([NONE; 3]);
        self.after.extend([NONE; 3]);
        let (out, back) = (first + (k + 1) % 3, first + (k + 2) % 3);
        let (before, after) = (self.before[h as usize], self.after[h as usize]);
        (self.before[h as usize], self.after[h as usize]) = (NONE, NONE);
        self.link(before, out);
        self.link(out, back);
        self.link(back, after);
        self.queue.extend([out, back]);
        self.close(before, out);
        if self.after[back as usize] == after {
            self.close(back, after);
        }
    }

    /// Joins two sides that follow each other while they are the same edge of the surface.
    fn close(&mut self, mut h: u32, mut next: u32) {
        while self.twin(h) == Some(self.on_surface(next)) {
            let (a, b) = (self.origin(h), self.end(next));
            let (before, after) = (self.before[h as usize], self.after[next as usize]);
            let both_of_chart = (a as usize) < self.n_chart && (b as usize) < self.n_chart;
            // Two sides that are left would close the boundary.
            let closes = self.after[after as usize] == before;
            if a == b || both_of_chart || closes {
                return;
            }
            // The numbers of the chart's vertices are the lower ones, and stay.
            self.joined[a.max(b) as usize] = a.min(b);
            for side in [h, next] {
                (self.before[side as usize], self.after[side as usize]) = (NONE, NONE);
            }
            self.link(before, after);
            (h, next) = (before, after);
        }
    }
    fn finish(self) -> Result<Grown> {
        let mut places = vec![NONE; self.vertices.len()];
        let mut vertices = Vec::new();
        for v in 0..self.vertices.len() {
            if self.joined[v] as usize == v {
                places[v] = vertices.len() as u32;
                vertices.push(self.vertices[v]);
            }
        }
        let positions = vertices
            .iter()
            .map(|&v| self.surface.vertices()[v as usize])
            .collect();
        let triangles: Vec<[i64; 3]> = self
            .corners
            .as_chunks()
            .0
            .iter()
            .map(|face: &[u32; 3]| face.map(|v| i64::from(places[self.number(v) as usize])))
            .collect();
        Ok(Grown {
            mesh: TriangleMesh::accepted(positions, &triangles)?,
            vertices,
            faces: self.faces,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grid, torus};

    fn grown(surface: &TriangleMesh, inside: impl Fn([f64; 3]) -> bool) -> (ChartMesh, Grown) {
        let centre = |f: usize| {
            let corners = surface.faces()[f].map(|v| surface.vertices()[v as usize]);
            [0, 1, 2].map(|axis| corners.iter().map(|p| p[axis]).sum::<f64>() / 3.0)
        };
        let (chart_faces, around): (Vec<i64>, Vec<i64>) =
            (0..surface.n_faces() as i64).partition(|&f| inside(centre(f as usize)));
        let chart = ChartMesh::new(surface, &chart_faces).unwrap();
        let both = grow(surface, &chart, &chart_faces, &around).unwrap();
        (chart, both)
    }

    #[test]
    fn block_grows_to_the_whole_grid() {
        let surface = grid(12, 12, |_, _| 0.0);
        let (chart, both) = grown(&surface, |p| {
            (p[0] - 0.5).abs().max((p[1] - 0.5).abs()) < 0.25
        });
        assert_eq!(both.mesh.n_faces(), surface.n_faces());
        assert_eq!(both.mesh.n_vertices(), surface.n_vertices());
        assert_eq!(both.mesh.euler_characteristic(), 1);
        let n = chart.mesh.n_faces();
        assert_eq!(&both.mesh.faces()[..n], chart.mesh.faces());
    }

    #[test]
    fn cut_ring_stays_cut() {
        let surface = torus(30, 12, 0.3);
        let (chart, both) = grown(&surface, |p| p[0] > 0.0);
        assert!(chart.cut_length > 0.0);
        assert_eq!(both.mesh.n_faces(), surface.n_faces());
        assert_eq!(both.mesh.euler_characteristic(), 1);
        assert_eq!(both.mesh.n_boundary_loops(), 1);
        let n = chart.mesh.n_faces();
        assert_eq!(&both.mesh.faces()[..n], chart.mesh.faces());
        assert_eq!(&both.vertices[..chart.vertices.len()], chart.vertices);
    }

    #[test]
    fn closed_surface_but_one_face_stays_a_disk() {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let surface =
            TriangleMesh::new(corners, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]).unwrap();
        for kept in 1..4 {
            let faces: Vec<i64> = (0..kept).collect();
            let chart = ChartMesh::new(&surface, &faces).unwrap();
            let around: Vec<i64> = (kept..4).collect();
            let both = grow(&surface, &chart, &faces, &around).unwrap();
            assert_eq!(both.mesh.n_faces(), 4);
            assert_eq!(both.mesh.euler_characteristic(), 1);
        }
    }
}
