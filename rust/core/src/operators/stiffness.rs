//! Cotangent stiffness S_ij = integral w grad theta_i . grad theta_j on one fixed pattern.

use rayon::prelude::*;

use crate::CHUNK;
use crate::mesh::{NONE, TriangleMesh};

/// The sparsity pattern of all stiffness matrices of a mesh: the off-diagonal entries by rows,
/// columns ascending, each with the edge that it belongs to. The diagonal is minus the sum of
/// its row and is not stored.
#[derive(Debug)]
pub struct StiffnessPattern {
    row_starts: Vec<usize>,
    columns: Vec<u32>,
    edge_of_entry: Vec<u32>,
}

impl StiffnessPattern {
    pub(crate) fn new(n: usize, edges: &[[u32; 2]]) -> Self {
        let mut row_starts = vec![0_usize; n + 1];
        for edge in edges {
            row_starts[edge[0] as usize + 1] += 1;
            row_starts[edge[1] as usize + 1] += 1;
        }
        for i in 0..n {
            row_starts[i + 1] += row_starts[i];
        }
        let mut columns = vec![0; 2 * edges.len()];
        let mut edge_of_entry = vec![0; 2 * edges.len()];
        let mut cursor = row_starts.clone();
        // Edges are sorted, so smaller columns of a row come first: lower part, then upper part.
        for (e, &[a, b]) in edges.iter().enumerate() {
            let entry = cursor[b as usize];
            columns[entry] = a;
            edge_of_entry[entry] = e as u32;
            cursor[b as usize] += 1;
        }
        for (e, &[a, b]) in edges.iter().enumerate() {
            let entry = cursor[a as usize];
            columns[entry] = b;
            edge_of_entry[entry] = e as u32;
            cursor[a as usize] += 1;
        }
        Self {
            row_starts,
            columns,
            edge_of_entry,
        }
    }

    pub fn row_starts(&self) -> &[usize] {
        &self.row_starts
    }

    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    pub fn edge_of_entry(&self) -> &[u32] {
        &self.edge_of_entry
    }

    /// (S u)_i = sum_j S_ij (u_j - u_i), exact zero on constants.
    #[inline]
    pub(crate) fn apply_row(&self, values: &[f64], u: &[f64], i: usize) -> f64 {
        let entries = self.row_starts[i]..self.row_starts[i + 1];
        let ui = u[i];
        self.columns[entries.clone()]
            .iter()
            .zip(&values[entries])
            .map(|(&j, &s)| s * (u[j as usize] - ui))
            .sum()
    }
}

/// The off-diagonal values of a stiffness matrix on the pattern of its mesh.
#[derive(Debug, Clone)]
pub struct Stiffness {
    edge_values: Vec<f64>,
    values: Vec<f64>,
}

impl Stiffness {
    /// The stiffness of the surface itself, w = 1.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut stiffness = Self {
            edge_values: vec![0.0; mesh.edges().len()],
            values: vec![0.0; mesh.pattern().columns.len()],
        };
        stiffness.fill(mesh, |_| 1.0);
        stiffness
    }

    /// The stiffness weighted with a vertex quantity, its value in a face the mean of the corners
    /// (midpoint quadrature, section 4), plus the constant `offset`.
    pub fn weighted(mesh: &TriangleMesh, weight: &[f64], offset: f64) -> Self {
        let mut stiffness = Self {
            edge_values: vec![0.0; mesh.edges().len()],
            values: vec![0.0; mesh.pattern().columns.len()],
        };
        stiffness.refill(mesh, weight, offset);
        stiffness
    }

    /// Refills the values for another weight, without allocation.
    pub fn refill(&mut self, mesh: &TriangleMesh, weight: &[f64], offset: f64) {
        self.fill(mesh, |f| mesh.face_mean(weight, f) + offset);
    }

    fn fill(&mut self, mesh: &TriangleMesh, face_weight: impl Fn(usize) -> f64 + Sync) {
        let cotangents = mesh.half_cotangents();
        let half_edges = mesh.edge_half_edges();
        let term = |half_edge: u32| {
            let (f, k) = ((half_edge / 3) as usize, (half_edge % 3) as usize);
            face_weight(f) * cotangents[f][k]
        };
        self.edge_values
            .par_chunks_mut(CHUNK)
            .zip(half_edges.par_chunks(CHUNK))
            .for_each(|(values, half_edges)| {
                for (value, sides) in values.iter_mut().zip(half_edges) {
                    *value = -term(sides[0]);
                    if sides[1] != NONE {
                        *value -= term(sides[1]);
                    }
                }
            });
        let edge_values = &self.edge_values;
        self.values
            .par_chunks_mut(CHUNK)
            .zip(mesh.pattern().edge_of_entry.par_chunks(CHUNK))
            .for_each(|(values, edges)| {
                for (value, &edge) in values.iter_mut().zip(edges) {
                    *value = edge_values[edge as usize];
                }
            });
    }

    /// Off-diagonal values in the order of the pattern.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// One value an edge, S_ij for the edge (i, j).
    pub fn edge_values(&self) -> &[f64] {
        &self.edge_values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::grid;

    #[test]
    fn exact_on_linear_functions() {
        let mesh = grid(7, 9, |_, _| 0.0);
        let stiffness = Stiffness::new(&mesh);
        let u: Vec<f64> = mesh.vertices().iter().map(|p| 2.0 * p[0] - p[1]).collect();
        let energy: f64 = (0..mesh.n_vertices())
            .map(|i| u[i] * mesh.pattern().apply_row(stiffness.values(), &u, i))
            .sum();
        assert!((energy - 5.0).abs() < 1e-12);
    }

    #[test]
    fn weight_is_the_face_mean() {
        let mesh = grid(6, 6, |x, y| 0.3 * x * y);
        let ones = vec![1.0; mesh.n_vertices()];
        let plain = Stiffness::new(&mesh);
        let weighted = Stiffness::weighted(&mesh, &ones, 1.0);
        for (a, b) in plain.values().iter().zip(weighted.values()) {
            assert!((2.0 * a - b).abs() < 1e-14);
        }
    }

    #[test]
    fn columns_ascend() {
        let mesh = grid(5, 4, |_, _| 0.0);
        let pattern = mesh.pattern();
        for i in 0..mesh.n_vertices() {
            let row = &pattern.columns()[pattern.row_starts()[i]..pattern.row_starts()[i + 1]];
            assert!(row.is_sorted());
        }
    }
}
