//! A surface cut open along the seams of a layout of texture coordinates, and the log scale of its
//! charts.

use std::sync::Arc;

use petgraph::unionfind::UnionFind;
use rayon::prelude::*;

use super::injective::faults;
use super::polygon::Point;
use crate::error::{Result, check_length};
use crate::graph::numbered;
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::{NONE, TriangleMesh};

/// Added to the diagonal where needles leave too few digits, relative to each entry.
const SHIFTS: [f64; 4] = [0.0, 1e-12, 1e-9, 1e-3];

/// Charts of a layout and the vertices of the surface that its seams leave.
#[derive(Debug)]
pub struct Layout {
    /// Chart of each face: a component over the edges that are no seams, in the order of their first
    /// faces.
    pub charts: Vec<u32>,
    /// Number of charts.
    pub n_charts: usize,
    /// Vertex of the cut surface at each corner, in the order of their first corners.
    pub corners: Vec<[u32; 3]>,
    /// Number of these vertices.
    pub n_vertices: usize,
    /// Whether the face and the one across each half-edge are of one chart there.
    pub joined: Vec<[bool; 3]>,
}

impl Layout {
    /// Cuts a surface open where texture coordinates on both sides differ by more than `tolerance`.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for coordinates that are not three a face.
    pub fn new(mesh: &TriangleMesh, uv: &[[Point; 3]], tolerance: f64) -> Result<Self> {
        check_length("uv", uv.len(), mesh.n_faces())?;
        let at = |h: u32| uv[h as usize / 3][h as usize % 3];
        let near = |a: u32, b: u32| {
            let ([x, y], [z, w]) = (at(a), at(b));
            (x - z).abs() <= tolerance && (y - w).abs() <= tolerance
        };
        let mut joined = vec![[false; 3]; mesh.n_faces()];
        let mut of_faces = UnionFind::<u32>::new(mesh.n_faces());
        let mut of_corners = UnionFind::<u32>::new(3 * mesh.n_faces());
        for &[h, twin] in mesh.edge_half_edges() {
            if twin == NONE || !(near(h, after(twin)) && near(after(h), twin)) {
                continue;
            }
            for side in [h, twin] {
                joined[side as usize / 3][side as usize % 3] = true;
            }
            of_faces.union(h / 3, twin / 3);
            of_corners.union(h, after(twin));
            of_corners.union(after(h), twin);
        }
        let (charts, n_charts) = numbered(of_faces.into_labeling());
        let (corners, n_vertices) = numbered(of_corners.into_labeling());
        Ok(Self {
            charts,
            n_charts,
            corners: corners.as_chunks().0.to_vec(),
            n_vertices,
            joined,
        })
    }

    /// The faces of each chart.
    fn members(&self) -> Vec<Vec<u32>> {
        let mut members = vec![Vec::new(); self.n_charts];
        for (f, &chart) in (0..).zip(&self.charts) {
            members[chart as usize].push(f);
        }
        members
    }

    /// How many charts have a boundary that crosses itself, see [`Faults`](super::Faults).
    ///
    /// # Errors
    /// [`crate::Error::Length`] for coordinates that are not three a face.
    pub fn crossing(&self, uv: &[[Point; 3]], thin: f64) -> Result<usize> {
        check_length("uv", uv.len(), self.corners.len())?;
        let mut points = vec![[0.0; 2]; self.n_vertices];
        for (corners, uv) in self.corners.iter().zip(uv) {
            for (&v, &point) in corners.iter().zip(uv) {
                points[v as usize] = point;
            }
        }
        let crosses = |faces: &Vec<u32>| {
            let faces: Vec<_> = faces.iter().map(|&f| self.corners[f as usize]).collect();
            faults(&faces, &points, thin).crosses
        };
        let members = self.members();
        Ok(members.par_iter().filter(|faces| crosses(faces)).count())
    }

    /// The log scale of the flat metric of each chart that keeps lengths on its boundary, at the
    /// vertices of the cut surface; not a number on charts without a boundary.
    ///
    /// It solves div grad u = K with u = 0 on the boundary, chart by chart.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn log_scales(&self, mesh: &TriangleMesh) -> Result<Vec<f64>> {
        check_length("mesh", mesh.n_faces(), self.corners.len())?;
        let mut on_boundary = vec![false; self.n_vertices];
        let mut is_open = vec![false; self.n_charts];
        let members = self.members();
        for (f, (joined, corners)) in self.joined.iter().zip(&self.corners).enumerate() {
            let chart = self.charts[f] as usize;
            for k in (0..3).filter(|&k| !joined[k]) {
                is_open[chart] = true;
                on_boundary[corners[k] as usize] = true;
                on_boundary[corners[(k + 1) % 3] as usize] = true;
            }
        }
        let solved: Vec<Vec<(u32, f64)>> = members
            .par_iter()
            .zip(&is_open)
            .map(|(faces, &is_open)| {
                if is_open {
                    self.log_scale(mesh, faces, &on_boundary)
                } else {
                    let corners = faces.iter().flat_map(|&f| self.corners[f as usize]);
                    Ok(corners.map(|v| (v, f64::NAN)).collect())
                }
            })
            .collect::<Result<_>>()?;
        let mut scales = vec![0.0; self.n_vertices];
        for (v, scale) in solved.into_iter().flatten() {
            scales[v as usize] = scale;
        }
        Ok(scales)
    }

    /// The log scale at the inner vertices of a chart.
    fn log_scale(
        &self,
        mesh: &TriangleMesh,
        faces: &[u32],
        on_boundary: &[bool],
    ) -> Result<Vec<(u32, f64)>> {
        let corners = || faces.iter().map(|&f| self.corners[f as usize]);
        let mut inner: Vec<u32> = corners()
            .flatten()
            .filter(|&v| !on_boundary[v as usize])
            .collect();
        inner.sort_unstable();
        inner.dedup();
        if inner.is_empty() {
            return Ok(Vec::new());
        }
        let n = inner.len();
        let local = |v: u32| inner.binary_search(&v).ok().map(|i| i as u32);
        let mut diagonal = vec![0.0; n];
        let mut defects = vec![std::f64::consts::TAU; n];
        // The entries below the diagonal, column first.
        let mut entries: Vec<((u32, u32), f64)> = Vec::with_capacity(3 * faces.len());
        for (&f, corners) in faces.iter().zip(corners()) {
            let places = corners.map(local);
            for (k, half) in mesh.half_cotangents()[f as usize].into_iter().enumerate() {
                // Opposite to half-edge k lies corner k + 2.
                let (a, b) = (places[k], places[(k + 1) % 3]);
                for place in [a, b].into_iter().flatten() {
                    diagonal[place as usize] += half;
                }
                if let (Some(a), Some(b)) = (a, b) {
                    entries.push(((a.min(b), a.max(b)), -half));
                }
                if let Some(apex) = places[(k + 2) % 3] {
                    defects[apex as usize] -= 1.0_f64.atan2(2.0 * half);
                }
            }
        }
        entries.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let (mut starts, mut rows) = (vec![0], Vec::with_capacity(entries.len() / 2 + n));
        let mut values = Vec::with_capacity(entries.len() / 2 + n);
        let mut groups = entries.chunk_by(|a, b| a.0 == b.0).peekable();
        for (column, diagonal) in (0..).zip(diagonal) {
            rows.push(column);
            values.push(diagonal);
            while let Some(group) = groups.next_if(|group| group[0].0.0 == column) {
                rows.push(group[0].0.1);
                values.push(group.iter().map(|entry| entry.1).sum());
            }
            starts.push(rows.len());
        }
        let symbolic = SymbolicFactorisation::new(
            &starts,
            &rows,
            Ordering::MinimumDegree,
            Factorisation::Automatic,
        )?;
        let mut cholesky = Cholesky::new(Arc::new(symbolic))?;
        for shift in SHIFTS {
            let mut shifted = values.clone();
            for &start in &starts[..n] {
                shifted[start] *= 1.0 + shift;
            }
            if cholesky.factor(&shifted).is_ok() {
                let mut scales: Vec<f64> = defects.iter().map(|defect| -defect).collect();
                cholesky.solve(&mut scales)?;
                return Ok(inner.into_iter().zip(scales).collect());
            }
        }
        Ok(inner.into_iter().map(|v| (v, f64::NAN)).collect())
    }
}

/// The next half-edge of a face.
fn after(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flatten::bff;
    use crate::testing::grid;

    #[test]
    fn a_disk_has_the_scale_of_its_boundary_first_map() {
        let mesh = grid(20, 20, |x, y| x * x - 0.5 * y * y * x);
        let uv: Vec<[Point; 3]> = mesh
            .faces()
            .iter()
            .map(|face| face.map(|v| [0, 1].map(|k| mesh.vertices()[v as usize][k])))
            .collect();
        let layout = Layout::new(&mesh, &uv, 1e-9).unwrap();
        assert_eq!((layout.n_charts, layout.n_vertices), (1, 21 * 21));
        let expected = bff(&mesh).unwrap().log_scale;
        let scales = layout.log_scales(&mesh).unwrap();
        for (face, corners) in mesh.faces().iter().zip(&layout.corners) {
            for (&v, &corner) in face.iter().zip(corners) {
                assert!((expected[v as usize] - scales[corner as usize]).abs() < 1e-12);
            }
        }
    }
}
