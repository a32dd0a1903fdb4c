//! Sparse Cholesky factorisation: analyse once, refactor into the same buffers, solve.
//!
//! The only user of faer. All of it runs with `Par::Seq`: callers that have two systems factor
//! them side by side.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};

use crate::error::{Error, Result, check_length};

/// Which numeric factorisation to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Factorisation {
    /// By the ratio of arithmetic to entries.
    #[default]
    Automatic,
    Simplicial,
    Supernodal,
}

/// The symbolic factorisation of all matrices of one sparsity pattern, ordered by approximate
/// minimum degree.
#[derive(Debug)]
pub struct Analysis {
    pattern: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
}

/// The Cholesky factor A = L L^T of symmetric positive definite matrices of one sparsity
/// pattern. Factors of the same pattern share its analysis.
pub struct Cholesky {
    analysis: Arc<Analysis>,
    factor: Vec<f64>,
    factor_stack: MemBuffer,
    solve_stack: MemBuffer,
    solve_columns: usize,
}

impl Analysis {
    /// Analyses the pattern of the lower triangle, by columns: the rows of column j, diagonal
    /// included, ascending, are `rows[column_starts[j]..column_starts[j + 1]]`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(
        column_starts: Vec<usize>,
        rows: Vec<usize>,
        factorisation: Factorisation,
    ) -> Result<Self> {
        let size = column_starts.len() - 1;
        let pattern = SymbolicSparseColMat::new_checked(size, size, column_starts, None, rows);
        let supernodal_flop_ratio_threshold = match factorisation {
            Factorisation::Automatic => SupernodalThreshold::AUTO,
            Factorisation::Simplicial => SupernodalThreshold::FORCE_SIMPLICIAL,
            Factorisation::Supernodal => SupernodalThreshold::FORCE_SUPERNODAL,
        };
        let symbolic = factorize_symbolic_cholesky(
            pattern.as_ref(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold,
                ..Default::default()
            },
        )
        .map_err(|_| out_of_memory(size))?;
        Ok(Self { pattern, symbolic })
    }
}

fn out_of_memory(size: usize) -> Error {
    Error::OutOfMemory {
        argument: "matrix",
        size,
    }
}

impl Cholesky {
    /// Makes the buffers of one factor.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(analysis: Arc<Analysis>) -> Result<Self> {
        let symbolic = &analysis.symbolic;
        let size = analysis.pattern.ncols();
        let factor_stack = MemBuffer::try_new(
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
        )
        .map_err(|_| out_of_memory(size))?;
        let solve_stack = MemBuffer::try_new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq))
            .map_err(|_| out_of_memory(size))?;
        Ok(Self {
            factor: vec![0.0; symbolic.len_val()],
            analysis,
            factor_stack,
            solve_stack,
            solve_columns: 1,
        })
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.analysis.pattern.ncols()
    }

    /// Entries of the factor that are stored.
    pub fn factor_entries(&self) -> usize {
        self.factor.len()
    }

    /// Factors the matrix with these lower-triangle values, in the order of the pattern.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names the pivot that failed.
    pub fn factor(&mut self, values: &[f64]) -> Result<()> {
        check_length(
            "values",
            values.len(),
            self.analysis.pattern.row_idx().len(),
        )?;
        let size = self.size();
        let matrix = SparseColMatRef::new(self.analysis.pattern.as_ref(), values);
        self.analysis
            .symbolic
            .factorize_numeric_llt::<f64>(
                &mut self.factor,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.factor_stack),
                Default::default(),
            )
            .map(|_| ())
            .map_err(
                |LltError::NonPositivePivot { index }| Error::NotPositiveDefinite {
                    argument: "matrix",
                    size,
                    pivot: index,
                },
            )
    }

    /// Solves A X = B in place; the columns of B stand one after the other in `columns`.
    ///
    /// # Errors
    /// [`Error::Length`] where `columns` is no multiple of the size.
    pub fn solve(&mut self, columns: &mut [f64]) -> Result<()> {
        let size = self.size();
        let n_columns = columns.len() / size;
        check_length("columns", columns.len(), n_columns * size)?;
        if n_columns > self.solve_columns {
            self.solve_stack = MemBuffer::try_new(
                self.analysis
                    .symbolic
                    .solve_in_place_scratch::<f64>(n_columns, Par::Seq),
            )
            .map_err(|_| out_of_memory(size))?;
            self.solve_columns = n_columns;
        }
        LltRef::new(&self.analysis.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(columns, size, n_columns),
            Par::Seq,
            MemStack::new(&mut self.solve_stack),
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lower triangle of the five-point Laplacian plus `shift` on a k x k grid.
    fn laplacian(k: usize, shift: f64) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..k * k {
            rows.push(j);
            values.push(4.0 + shift);
            if (j + 1) % k != 0 {
                rows.push(j + 1);
                values.push(-1.0);
            }
            if j + k < k * k {
                rows.push(j + k);
                values.push(-1.0);
            }
            starts.push(rows.len());
        }
        (starts, rows, values)
    }

    fn residual(starts: &[usize], rows: &[usize], values: &[f64], x: &[f64], b: &[f64]) -> f64 {
        let mut r = b.to_vec();
        for j in 0..x.len() {
            for e in starts[j]..starts[j + 1] {
                r[rows[e]] -= values[e] * x[j];
                if rows[e] != j {
                    r[j] -= values[e] * x[rows[e]];
                }
            }
        }
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        norm(&r) / norm(b)
    }

    #[test]
    fn both_factorisations_solve() {
        for factorisation in [Factorisation::Simplicial, Factorisation::Supernodal] {
            let (starts, rows, values) = laplacian(30, 0.01);
            let analysis = Analysis::new(starts.clone(), rows.clone(), factorisation).unwrap();
            let mut cholesky = Cholesky::new(Arc::new(analysis)).unwrap();
            for scale in [1.0, 3.0] {
                let scaled: Vec<f64> = values.iter().map(|v| v * scale).collect();
                cholesky.factor(&scaled).unwrap();
                let b: Vec<f64> = (0..1800).map(|i| (i as f64 * 0.37).sin()).collect();
                let mut x = b.clone();
                cholesky.solve(&mut x).unwrap();
                for c in 0..2 {
                    let part = c * 900..(c + 1) * 900;
                    let error =
                        residual(&starts, &rows, &scaled, &x[part.clone()], &b[part.clone()]);
                    assert!(error < 1e-10, "{error}");
                }
            }
        }
    }

    #[test]
    fn indefinite_matrix_names_its_pivot() {
        let (starts, rows, values) = laplacian(10, -3.0);
        let analysis = Analysis::new(starts, rows, Factorisation::Automatic).unwrap();
        let mut cholesky = Cholesky::new(Arc::new(analysis)).unwrap();
        assert!(matches!(
            cholesky.factor(&values),
            Err(Error::NotPositiveDefinite { size: 100, .. })
        ));
    }
}
