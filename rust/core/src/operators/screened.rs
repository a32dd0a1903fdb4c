//! The screened Poisson equation u - div(epsilon^2 grad u) = f, which spreads f over the width
//! epsilon.

use std::sync::Arc;

use super::stiffness::Stiffness;
use crate::error::{Result, check_length};
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::TriangleMesh;

/// The factored matrix M + S\[epsilon^2\] of a mesh, with lumped mass and natural boundary.
///
/// Where both angles that face an edge are obtuse, or nearly so, the edge's entry would be positive;
/// it is 0 instead. So the matrix is an M-matrix on any mesh, and a solution lies between the least
/// and the largest value of f.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::operators::Screened;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let mut values = vec![1.0, 0.0, 1.0, 0.0];
/// Screened::new(&square, &[10.0, 10.0])?.solve(&mut values)?;
/// assert!(values.iter().all(|u| (u - 2.0 / 3.0).abs() < 1e-2));
/// # Ok(())
/// # }
/// ```
pub struct Screened {
    cholesky: Cholesky,
    mass: Vec<f64>,
}

impl Screened {
    /// Factors the matrix; `epsilon` has a width for each face.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for widths that are not one a face, [`crate::Error::NotPositiveDefinite`] where
    /// areas underflow, [`crate::Error::OutOfMemory`].
    pub fn new(mesh: &TriangleMesh, epsilon: &[f64]) -> Result<Self> {
        check_length("epsilon", epsilon.len(), mesh.n_faces())?;
        let stiffness = Stiffness::by_face(mesh, |f| epsilon[f] * epsilon[f]);
        let n = mesh.n_vertices();
        let edges = mesh.edges().len();
        let mut starts = Vec::with_capacity(n + 1);
        let mut rows = Vec::with_capacity(n + edges);
        let mut values = Vec::with_capacity(n + edges);
        starts.push(0);
        for (j, &mass) in mesh.mass().iter().enumerate() {
            let diagonal = values.len();
            rows.push(j as u32);
            values.push(mass);
            for (i, edge) in mesh.adjacency().around(j) {
                let value = stiffness.edge_values()[edge].min(0.0);
                values[diagonal] -= value;
                if i > j {
                    rows.push(i as u32);
                    values.push(value);
                }
            }
            starts.push(rows.len());
        }
        let symbolic = SymbolicFactorisation::new(
            &starts,
            &rows,
            Ordering::LeastWork,
            Factorisation::Automatic,
        )?;
        let mut cholesky = Cholesky::new(Arc::new(symbolic))?;
        cholesky.factor(&values)?;
        Ok(Self {
            cholesky,
            mass: mesh.mass().to_vec(),
        })
    }

    /// Solves for some f in place, given at the vertices one after the other.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for a length that is no multiple of the number of vertices.
    pub fn solve(&mut self, columns: &mut [f64]) -> Result<()> {
        let n = self.mass.len();
        check_length("columns", columns.len(), columns.len() / n * n)?;
        for column in columns.chunks_mut(n) {
            for (value, mass) in column.iter_mut().zip(&self.mass) {
                *value *= mass;
            }
        }
        self.cholesky.solve(columns)
    }

    /// Spreads the indicators of labels: for each of `labels`, in turn, the share of the area
    /// around each vertex whose face has that label, spread. Over all labels they sum to 1.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for `of_faces` that are not one a face of the mesh, or `values` that are
    /// not one for each of the labels and vertices.
    pub fn spread(
        &mut self,
        mesh: &TriangleMesh,
        of_faces: &[i64],
        labels: &[i64],
        values: &mut [f64],
    ) -> Result<()> {
        let n = self.mass.len();
        check_length("labels", of_faces.len(), mesh.n_faces())?;
        check_length("values", values.len(), labels.len() * n)?;
        values.fill(0.0);
        for ((face, area), label) in mesh.faces().iter().zip(mesh.areas()).zip(of_faces) {
            for (_, column) in labels
                .iter()
                .zip(values.chunks_mut(n))
                .filter(|(wanted, _)| *wanted == label)
            {
                for &v in face {
                    column[v as usize] += area / 3.0;
                }
            }
        }
        self.cholesky.solve(values)?;
        // Nothing but rounding is cut off.
        for value in values {
            *value = value.clamp(0.0, 1.0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn constants_stay() {
        let mesh = grid(9, 7, |x, y| 0.4 * x * y + x * x);
        let mut screened = Screened::new(&mesh, &vec![0.3; mesh.n_faces()]).unwrap();
        let mut ones = vec![1.0; 2 * mesh.n_vertices()];
        screened.solve(&mut ones).unwrap();
        assert!(ones.iter().all(|u| (u - 1.0).abs() < 1e-13));
    }

    #[test]
    fn labels_share_among_themselves() {
        // Needles: most edges of the flattened grid face two obtuse angles.
        let mesh = grid(30, 30, |x, y| 20.0 * (x + y));
        let labels: Vec<i64> = (0..mesh.n_faces() as i64).map(|f| f * f % 3).collect();
        let mut screened = Screened::new(&mesh, &vec![0.1; mesh.n_faces()]).unwrap();
        let n = mesh.n_vertices();
        let mut values = vec![0.0; 3 * n];
        screened
            .spread(&mesh, &labels, &[0, 1, 2], &mut values)
            .unwrap();
        for v in 0..n {
            let at = [values[v], values[n + v], values[2 * n + v]];
            assert!(at.iter().all(|w| (0.0..=1.0).contains(w)));
            assert!((at.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        let mut alone = vec![0.0; n];
        screened.spread(&mesh, &labels, &[1], &mut alone).unwrap();
        assert_eq!(alone, values[n..2 * n]);
    }
}
