//! Cotangent stiffness S_ij = integral w grad theta_i . grad theta_j.

use rayon::prelude::*;

use crate::mesh::{Adjacency, NONE, TriangleMesh};
use crate::parallel::CHUNK;

/// The off-diagonal values of a stiffness matrix: one for each entry of the mesh's [`Adjacency`].
/// The diagonal is minus the sum of its row and is not stored.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::operators::Stiffness;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let mesh = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// // Right angles face the diagonal, angles of 45 degrees the sides.
/// let expected = [-0.5, 0.0, -0.5, -0.5, -0.5];
/// for (value, expected) in Stiffness::new(&mesh).edge_values().iter().zip(expected) {
///     assert!((value - expected).abs() < 1e-15);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Stiffness {
    edge_values: Vec<f64>,
    values: Vec<f64>,
}

impl Stiffness {
    /// The stiffness of the surface itself, w = 1.
    #[must_use]
    pub fn new(mesh: &TriangleMesh) -> Self {
        Self::by_face(mesh, |_| 1.0)
    }

    /// The stiffness weighted with a vertex quantity, its value in a face the mean of the corners
    /// (midpoint quadrature, section 4), plus the constant `offset`.
    #[must_use]
    pub fn weighted(mesh: &TriangleMesh, weight: &[f64], offset: f64) -> Self {
        Self::by_face(mesh, |f| mesh.face_mean(weight, f) + offset)
    }

    /// The stiffness weighted with a value for each face.
    #[must_use]
    pub fn by_face(mesh: &TriangleMesh, weight: impl Fn(usize) -> f64 + Sync) -> Self {
        let mut stiffness = Self {
            edge_values: vec![0.0; mesh.edges().len()],
            values: vec![0.0; mesh.adjacency().edges().len()],
        };
        stiffness.fill(mesh, weight);
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
            .zip(mesh.adjacency().edges().par_chunks(CHUNK))
            .for_each(|(values, edges)| {
                for (value, &edge) in values.iter_mut().zip(edges) {
                    *value = edge_values[edge as usize];
                }
            });
    }

    /// (S u)_i = sum_j S_ij (u_j - u_i), exact zero on constants.
    #[inline]
    pub(crate) fn apply_row(&self, adjacency: &Adjacency, u: &[f64], i: usize) -> f64 {
        let entries = adjacency.starts()[i]..adjacency.starts()[i + 1];
        let ui = u[i];
        adjacency.vertices()[entries.clone()]
            .iter()
            .zip(&self.values[entries])
            .map(|(&j, &s)| s * (u[j as usize] - ui))
            .sum()
    }

    /// S_ii.
    #[inline]
    pub(crate) fn diagonal(&self, adjacency: &Adjacency, i: usize) -> f64 {
        let row = &self.values[adjacency.starts()[i]..adjacency.starts()[i + 1]];
        -row.iter().sum::<f64>()
    }

    /// Off-diagonal values in the order of the mesh's [`Adjacency`].
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// One value an edge, S_ij for the edge (i, j).
    #[must_use]
    pub fn edge_values(&self) -> &[f64] {
        &self.edge_values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn exact_on_linear_functions() {
        let mesh = grid(7, 9, |_, _| 0.0);
        let stiffness = Stiffness::new(&mesh);
        let u: Vec<f64> = mesh.vertices().iter().map(|p| 2.0 * p[0] - p[1]).collect();
        let energy: f64 = (0..mesh.n_vertices())
            .map(|i| u[i] * stiffness.apply_row(mesh.adjacency(), &u, i))
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
}
