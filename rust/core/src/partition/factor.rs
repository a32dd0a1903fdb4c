//! Factors of matrices of some hundred rows that are needed once.
//!
//! [`crate::linear`] analyses a pattern with care, for factors of many matrices; here the analysis would
//! take longer than the arithmetic. From [`LARGE`] rows on its dense blocks win.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::NONE;

/// Rows from which on a factor by dense blocks is quicker.
const LARGE: usize = 2500;

/// A symmetric matrix, its rows in an order of little fill.
#[derive(Debug, Default)]
pub(super) struct Matrix {
    pub diagonal: Vec<f64>,
    /// Entries left of the diagonal: those of row `k` are `starts[k]..starts[k + 1]`.
    pub starts: Vec<usize>,
    pub columns: Vec<u32>,
    pub values: Vec<f64>,
}

/// The factor of a positive definite matrix.
pub(super) enum Factor {
    Rows(Rows),
    Blocks(Box<Cholesky>),
}

/// L D L^T, row by row (Davis 2005); L has a unit diagonal and is stored by columns.
#[expect(clippy::struct_field_names, reason = "the row of each entry")]
pub(super) struct Rows {
    starts: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
    diagonal: Vec<f64>,
}

impl Factor {
    /// # Errors
    /// [`Error::NotPositiveDefinite`], [`Error::OutOfMemory`].
    pub fn new(matrix: &Matrix) -> Result<Self> {
        if matrix.diagonal.len() < LARGE {
            Ok(Self::Rows(Rows::new(matrix)?))
        } else {
            Ok(Self::Blocks(Box::new(blocks(matrix)?)))
        }
    }

    /// Solves in place for right-hand sides that stand one after the other.
    ///
    /// # Errors
    /// [`Error::Length`] where they are no multiple of the size.
    pub fn solve(&mut self, columns: &mut [f64]) -> Result<()> {
        match self {
            Self::Rows(factor) => {
                for x in columns.chunks_exact_mut(factor.diagonal.len().max(1)) {
                    factor.solve(x);
                }
                Ok(())
            }
            Self::Blocks(cholesky) => cholesky.solve(columns),
        }
    }
}

impl Rows {
    fn new(matrix: &Matrix) -> Result<Self> {
        let n = matrix.diagonal.len();
        let row = |k: usize| matrix.starts[k]..matrix.starts[k + 1];
        // The elimination tree and the entries of each column.
        let mut parents = vec![NONE; n];
        let mut flags = vec![NONE; n];
        let mut counts = vec![0_u32; n + 1];
        for k in 0..n {
            flags[k] = k as u32;
            for &i in &matrix.columns[row(k)] {
                let mut i = i as usize;
                while flags[i] != k as u32 {
                    if parents[i] == NONE {
                        parents[i] = k as u32;
                    }
                    counts[i + 1] += 1;
                    flags[i] = k as u32;
                    i = parents[i] as usize;
                }
            }
        }
        for k in 0..n {
            counts[k + 1] += counts[k];
        }
        let starts = counts;
        let total = starts[n] as usize;
        let mut ends: Vec<u32> = starts[..n].to_vec();
        let mut rows = vec![0_u32; total];
        let mut values = vec![0.0; total];
        let mut diagonal = vec![0.0; n];
        let mut y = vec![0.0; n];
        let mut pattern = vec![0_u32; n];
        let mut path = Vec::with_capacity(n);
        flags.fill(NONE);
        for k in 0..n {
            flags[k] = k as u32;
            let mut top = n;
            for e in row(k) {
                let mut i = matrix.columns[e] as usize;
                y[i] += matrix.values[e];
                path.clear();
                while flags[i] != k as u32 {
                    path.push(i as u32);
                    flags[i] = k as u32;
                    i = parents[i] as usize;
                }
                while let Some(i) = path.pop() {
                    top -= 1;
                    pattern[top] = i;
                }
            }
            let mut pivot = matrix.diagonal[k];
            for &i in &pattern[top..] {
                let i = i as usize;
                let value = std::mem::take(&mut y[i]);
                let column = starts[i] as usize..ends[i] as usize;
                for (&r, x) in rows[column.clone()].iter().zip(&values[column.clone()]) {
                    y[r as usize] -= x * value;
                }
                let entry = value / diagonal[i];
                pivot -= entry * value;
                rows[column.end] = k as u32;
                values[column.end] = entry;
                ends[i] += 1;
            }
            if !(pivot > 0.0 && pivot.is_finite()) {
                return Err(Error::NotPositiveDefinite {
                    argument: "matrix",
                    size: n,
                    vertex: k,
                });
            }
            diagonal[k] = pivot;
        }
        Ok(Self {
            starts,
            rows,
            values,
            diagonal,
        })
    }

    fn column(&self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.starts[k] as usize..self.starts[k + 1] as usize;
        let rows = self.rows[range.clone()].iter().map(|&r| r as usize);
        rows.zip(self.values[range].iter().copied())
    }

    fn solve(&self, x: &mut [f64]) {
        for k in 0..x.len() {
            let value = x[k];
            for (r, entry) in self.column(k) {
                x[r] -= entry * value;
            }
        }
        for k in (0..x.len()).rev() {
            let sum: f64 = self.column(k).map(|(r, entry)| entry * x[r]).sum();
            x[k] = x[k] / self.diagonal[k] - sum;
        }
    }
}

/// By dense blocks; the lower triangle by columns is the upper one by rows, of the order reversed.
fn blocks(matrix: &Matrix) -> Result<Cholesky> {
    let n = matrix.diagonal.len();
    let mut starts = vec![0_usize; n + 1];
    for &i in &matrix.columns {
        starts[i as usize + 1] += 1;
    }
    for k in 0..n {
        starts[k + 1] += starts[k] + 1;
    }
    let mut cursor = starts.clone();
    let mut rows = vec![0; starts[n]];
    let mut values = vec![0.0; starts[n]];
    for k in 0..n {
        rows[cursor[k]] = k as u32;
        values[cursor[k]] = matrix.diagonal[k];
        cursor[k] += 1;
        for e in matrix.starts[k]..matrix.starts[k + 1] {
            let i = matrix.columns[e] as usize;
            rows[cursor[i]] = k as u32;
            values[cursor[i]] = matrix.values[e];
            cursor[i] += 1;
        }
    }
    let analysis =
        SymbolicFactorisation::new(&starts, &rows, Ordering::Given, Factorisation::Automatic)?;
    let mut cholesky = Cholesky::new(Arc::new(analysis))?;
    cholesky.factor(&values)?;
    Ok(cholesky)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// The five-point Laplacian on a k x k grid with random weights.
    fn laplacian(k: usize) -> Matrix {
        let mut random = Random::new(k as u64, 0);
        let mut matrix = Matrix {
            diagonal: vec![0.1; k * k],
            starts: vec![0],
            ..Matrix::default()
        };
        for row in 0..k * k {
            let left = (row % k > 0).then(|| row - 1);
            for column in [row.checked_sub(k), left].into_iter().flatten() {
                let weight = 0.5 + random.unit();
                matrix.columns.push(column as u32);
                matrix.values.push(-weight);
                matrix.diagonal[row] += weight;
                matrix.diagonal[column] += weight;
            }
            matrix.starts.push(matrix.columns.len());
        }
        matrix
    }

    #[test]
    fn both_solve() {
        for k in [1, 2, 7, 20] {
            let matrix = laplacian(k);
            let n = k * k;
            let mut random = Random::new(1, 1);
            let x: Vec<f64> = (0..2 * n).map(|_| random.unit()).collect();
            let mut b = vec![0.0; 2 * n];
            for (x, b) in x.chunks(n).zip(b.chunks_mut(n)) {
                for r in 0..n {
                    b[r] += matrix.diagonal[r] * x[r];
                    for e in matrix.starts[r]..matrix.starts[r + 1] {
                        let c = matrix.columns[e] as usize;
                        b[r] += matrix.values[e] * x[c];
                        b[c] += matrix.values[e] * x[r];
                    }
                }
            }
            let factors = [
                Factor::Rows(Rows::new(&matrix).unwrap()),
                Factor::Blocks(Box::new(blocks(&matrix).unwrap())),
            ];
            for mut factor in factors {
                let mut solution = b.clone();
                factor.solve(&mut solution).unwrap();
                for (s, x) in solution.iter().zip(&x) {
                    assert!((s - x).abs() < 1e-12, "{s} {x}");
                }
            }
        }
    }

    #[test]
    fn indefinite_is_refused() {
        let mut matrix = laplacian(4);
        matrix.diagonal[9] = -1.0;
        assert!(matches!(
            Factor::new(&matrix),
            Err(Error::NotPositiveDefinite { vertex: 9, .. })
        ));
    }
}
