//! The matrix of the Dirichlet problem: a stiffness with an added diagonal, fixed on the boundary.

use std::sync::Arc;

use super::stiffness::Stiffness;
use crate::error::Result;
use crate::linear::{Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::{NONE, TriangleMesh};

/// The lower triangle, by columns, of the matrices S + diag(d) of a mesh, and their one symbolic
/// factorisation. Unknowns on the boundary are fixed: their rows and columns are those of the
/// identity.
///
/// # Examples
/// The temperature of a plate that is heated evenly and cold on its boundary:
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::linear::{Cholesky, Ordering};
/// use phaseatlas_core::operators::{DirichletSystem, Stiffness};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let rim = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
/// let vertices = [vec![[0.0; 3]], rim.to_vec()].concat();
/// let plate = TriangleMesh::new(vertices, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])?;
/// let system = DirichletSystem::new(&plate, Ordering::MinimumDegree)?;
/// let mut values = vec![0.0; system.len()];
/// system.fill(&plate, &Stiffness::new(&plate), &[0.0; 5], &mut values);
/// let mut cholesky = Cholesky::new(system.symbolic())?;
/// cholesky.factor(&values)?;
/// let mut temperature = plate.mass().to_vec();
/// temperature[1..].fill(0.0);
/// cholesky.solve(&mut temperature)?;
/// assert!((temperature[0] - 1.0 / 6.0).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct DirichletSystem {
    column_starts: Vec<usize>,
    /// The edge of each entry below the diagonal, [`NONE`] where an end is fixed; the first entry
    /// of a column is the diagonal.
    edges: Vec<u32>,
    symbolic: Arc<SymbolicFactorisation>,
}

impl DirichletSystem {
    /// Analyses the pattern of the matrices.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(mesh: &TriangleMesh, ordering: Ordering) -> Result<Self> {
        let fixed = mesh.on_boundary();
        let mut column_starts = vec![0];
        let (mut rows, mut edges) = (Vec::new(), Vec::new());
        for j in 0..mesh.n_vertices() {
            rows.push(j as u32);
            edges.push(NONE);
            for (i, edge) in mesh.adjacency().around(j).filter(|&(i, _)| i > j) {
                rows.push(i as u32);
                edges.push(if fixed[i] || fixed[j] {
                    NONE
                } else {
                    edge as u32
                });
            }
            column_starts.push(rows.len());
        }
        let symbolic =
            SymbolicFactorisation::new(&column_starts, &rows, ordering, Factorisation::Automatic)?;
        Ok(Self {
            column_starts,
            edges,
            symbolic: Arc::new(symbolic),
        })
    }

    /// Number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.edges.len()
    }

    /// Whether there are none: never so for a mesh.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The symbolic factorisation, which all factors share.
    #[must_use]
    pub fn symbolic(&self) -> Arc<SymbolicFactorisation> {
        self.symbolic.clone()
    }

    /// Writes the entries of S + diag(`diagonal`), identity on the boundary, to `values`.
    pub fn fill(
        &self,
        mesh: &TriangleMesh,
        stiffness: &Stiffness,
        diagonal: &[f64],
        values: &mut [f64],
    ) {
        let edge_values = stiffness.edge_values();
        for (j, (&added, &fixed)) in diagonal.iter().zip(mesh.on_boundary()).enumerate() {
            let column = self.column_starts[j]..self.column_starts[j + 1];
            values[column.start] = if fixed {
                1.0
            } else {
                added + stiffness.diagonal(mesh.adjacency(), j)
            };
            let below = column.start + 1..column.end;
            for (value, &edge) in values[below.clone()].iter_mut().zip(&self.edges[below]) {
                *value = if edge == NONE {
                    0.0
                } else {
                    edge_values[edge as usize]
                };
            }
        }
    }
}
