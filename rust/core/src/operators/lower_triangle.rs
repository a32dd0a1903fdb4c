//! Lower triangle, by columns, of stiffness matrices with an added diagonal: what the Cholesky
//! factorisation takes.

use std::sync::Arc;

use super::StiffnessPattern;
use crate::error::Result;
use crate::linear::{Analysis, Factorisation, Ordering};
use crate::mesh::NONE;

/// The pattern of all such matrices of a mesh, analysed once. Unknowns on the border of the mesh
/// are fixed: their rows and columns are those of the identity.
#[derive(Debug)]
pub struct LowerTriangle {
    column_starts: Vec<usize>,
    /// The edge of each entry below the diagonal, [`NONE`] where an end is fixed; the first entry
    /// of a column is the diagonal.
    edges: Vec<u32>,
    fixed: Vec<bool>,
    analysis: Arc<Analysis>,
}

impl LowerTriangle {
    pub(crate) fn new(
        pattern: &StiffnessPattern,
        fixed: &[bool],
        ordering: Ordering,
    ) -> Result<Self> {
        let n = pattern.row_starts().len() - 1;
        let mut column_starts = vec![0];
        let (mut rows, mut edges) = (Vec::new(), Vec::new());
        for j in 0..n {
            rows.push(j as u32);
            edges.push(NONE);
            for entry in pattern.row_starts()[j]..pattern.row_starts()[j + 1] {
                let i = pattern.columns()[entry] as usize;
                if i > j {
                    rows.push(i as u32);
                    edges.push(if fixed[i] || fixed[j] {
                        NONE
                    } else {
                        pattern.edge_of_entry()[entry]
                    });
                }
            }
            column_starts.push(rows.len());
        }
        let analysis = Analysis::new(&column_starts, &rows, ordering, Factorisation::Automatic)?;
        Ok(Self {
            column_starts,
            edges,
            fixed: fixed.to_vec(),
            analysis: Arc::new(analysis),
        })
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.edges.len()
    }

    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    pub fn analysis(&self) -> Arc<Analysis> {
        self.analysis.clone()
    }

    /// Writes the entries of S + diag(diagonal), S given by its edge values, identity where fixed.
    pub fn fill(
        &self,
        pattern: &StiffnessPattern,
        edge_values: &[f64],
        diagonal: &[f64],
        values: &mut [f64],
    ) {
        for (j, &added) in diagonal.iter().enumerate() {
            let row = pattern.row_starts()[j]..pattern.row_starts()[j + 1];
            let sum: f64 = pattern.edge_of_entry()[row]
                .iter()
                .map(|&e| edge_values[e as usize])
                .sum();
            let column = self.column_starts[j]..self.column_starts[j + 1];
            values[column.start] = if self.fixed[j] { 1.0 } else { added - sum };
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
