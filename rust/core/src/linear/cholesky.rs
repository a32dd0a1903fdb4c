//! Sparse Cholesky factorisation: refactor into the same buffers, solve.
//!
//! The column-by-column factorisation and the dense kernels are faer's; the factorisation by blocks
//! is in `supernodal.rs`. All of it runs on one thread: callers that have two systems factor them
//! side by side. Only the first factorisation on a thread and a solve with more right-hand sides
//! than before allocate.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::SparseColMatRef;
use faer::sparse::linalg::cholesky::simplicial::{
    SimplicialLltRef, factorize_simplicial_numeric_llt, factorize_simplicial_numeric_llt_scratch,
};
use faer::{Conj, MatMut, Par};

use super::memory::buffer;
use super::supernodal::Blocks;
use super::symbolic::{Pattern, SymbolicFactorisation};
use crate::error::{Error, Result, check_length};

/// The Cholesky factor A = L L^T of symmetric positive definite matrices of one sparsity
/// pattern. Factors of one pattern share its symbolic factorisation.
///
/// # Examples
/// ```
/// use std::sync::Arc;
///
/// use phaseatlas_core::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // The lower triangle of [[4, 2], [2, 3]], by columns.
/// let symbolic = SymbolicFactorisation::new(
///     &[0, 2, 3],
///     &[0, 1, 1],
///     Ordering::MinimumDegree,
///     Factorisation::Automatic,
/// )?;
/// let mut cholesky = Cholesky::new(Arc::new(symbolic))?;
/// cholesky.factor(&[4.0, 2.0, 3.0])?;
/// let mut x = [8.0, 8.0];
/// cholesky.solve(&mut x)?;
/// assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 2.0).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
pub struct Cholesky {
    symbolic: Arc<SymbolicFactorisation>,
    /// Values of the permuted triangle.
    values: Vec<f64>,
    factor: Vec<f64>,
    /// Right-hand sides, then solutions, in the order of elimination.
    permuted: Vec<f64>,
    blocks: Blocks,
    stack: MemBuffer,
}

impl Cholesky {
    /// Makes the buffers of one factor.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(symbolic: Arc<SymbolicFactorisation>) -> Result<Self> {
        let n = symbolic.size();
        let (blocks, request) = match &symbolic.pattern {
            Pattern::Simplicial { .. } => (
                Blocks::default(),
                factorize_simplicial_numeric_llt_scratch::<u32, f64>(n),
            ),
            Pattern::Supernodal(supernodes) => (supernodes.blocks(), supernodes.scratch()),
        };
        Ok(Self {
            values: vec![0.0; symbolic.slots.len()],
            factor: vec![0.0; symbolic.factor_entries()],
            permuted: vec![0.0; n],
            blocks,
            stack: buffer(n, request)?,
            symbolic,
        })
    }

    /// Number of rows.
    #[must_use]
    pub fn size(&self) -> usize {
        self.symbolic.size()
    }

    /// Factors the matrix with these lower-triangle values, in the order of the caller's pattern.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names the row whose pivot is not a positive number.
    pub fn factor(&mut self, values: &[f64]) -> Result<()> {
        let symbolic = &*self.symbolic;
        check_length("values", values.len(), symbolic.slots.len())?;
        let stack = MemStack::new(&mut self.stack);
        let placed = values.iter().zip(&symbolic.slots);
        let outcome = match &symbolic.pattern {
            Pattern::Simplicial { symbolic, upper } => {
                for (&value, &slot) in placed {
                    self.values[slot as usize] = value;
                }
                factorize_simplicial_numeric_llt(
                    &mut self.factor,
                    SparseColMatRef::new(upper.as_ref(), &self.values),
                    LltRegularization::default(),
                    symbolic,
                    stack,
                )
                .map(|_| ())
                // This one counts from 1.
                .map_err(|LltError::NonPositivePivot { index }| index - 1)
            }
            Pattern::Supernodal(supernodes) => {
                for (&value, &slot) in placed {
                    let slot = slot as usize;
                    if self.values[slot].to_bits() != value.to_bits() {
                        self.values[slot] = value;
                        supernodes.mark_changed(slot, &mut self.blocks);
                    }
                }
                supernodes.factor(&self.values, &mut self.factor, &mut self.blocks, stack)
            }
        };
        outcome.map_err(|step| Error::NotPositiveDefinite {
            argument: "matrix",
            size: symbolic.size(),
            vertex: symbolic.order()[step] as usize,
        })
    }

    /// Solves A X = B in place; the columns of B stand one after the other in `columns`.
    ///
    /// # Errors
    /// [`Error::Length`] where `columns` is no multiple of the size.
    pub fn solve(&mut self, columns: &mut [f64]) -> Result<()> {
        let symbolic = &*self.symbolic;
        let size = symbolic.size();
        let n_columns = columns.len() / size;
        check_length("columns", columns.len(), n_columns * size)?;
        if columns.len() > self.permuted.len() {
            self.permuted.resize(columns.len(), 0.0);
        }
        let permuted = &mut self.permuted[..columns.len()];
        for (to, from) in permuted.chunks_mut(size).zip(columns.chunks(size)) {
            for (value, &row) in to.iter_mut().zip(symbolic.order()) {
                *value = from[row as usize];
            }
        }
        match &symbolic.pattern {
            Pattern::Simplicial { symbolic, .. } => SimplicialLltRef::new(symbolic, &self.factor)
                .solve_in_place_with_conj(
                    Conj::No,
                    MatMut::from_column_major_slice_mut(permuted, size, n_columns),
                    Par::Seq,
                    MemStack::new(&mut self.stack),
                ),
            Pattern::Supernodal(supernodes) => {
                supernodes.solve(&self.factor, permuted, &mut self.blocks);
            }
        }
        for (from, to) in self.permuted.chunks(size).zip(columns.chunks_mut(size)) {
            for (&value, &row) in from.iter().zip(symbolic.order()) {
                to[row as usize] = value;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::{Factorisation, Ordering};
    use crate::testing::laplacian;

    fn residual(starts: &[usize], rows: &[u32], values: &[f64], x: &[f64], b: &[f64]) -> f64 {
        let mut r = b.to_vec();
        for j in 0..x.len() {
            for e in starts[j]..starts[j + 1] {
                r[rows[e] as usize] -= values[e] * x[j];
                if rows[e] as usize != j {
                    r[j] -= values[e] * x[rows[e] as usize];
                }
            }
        }
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        norm(&r) / norm(b)
    }

    const BOTH: [Factorisation; 2] = [Factorisation::Simplicial, Factorisation::Supernodal];

    fn factor_of(starts: &[usize], rows: &[u32], factorisation: Factorisation) -> Cholesky {
        let symbolic =
            SymbolicFactorisation::new(starts, rows, Ordering::LeastWork, factorisation).unwrap();
        Cholesky::new(Arc::new(symbolic)).unwrap()
    }

    #[test]
    fn both_factorisations_solve() {
        let (starts, rows, values) = laplacian(30, 0.01);
        for factorisation in BOTH {
            for ordering in [Ordering::MinimumDegree, Ordering::LeastWork] {
                let symbolic =
                    SymbolicFactorisation::new(&starts, &rows, ordering, factorisation).unwrap();
                let mut cholesky = Cholesky::new(Arc::new(symbolic)).unwrap();
                for (scale, n_columns) in [(1.0, 1), (3.0, 3), (0.1, 2)] {
                    let scaled: Vec<f64> = values.iter().map(|v| v * scale).collect();
                    cholesky.factor(&scaled).unwrap();
                    let b: Vec<f64> = (0..n_columns * 900)
                        .map(|i| (f64::from(i) * 0.37).sin())
                        .collect();
                    let mut x = b.clone();
                    cholesky.solve(&mut x).unwrap();
                    for (x, b) in x.chunks(900).zip(b.chunks(900)) {
                        let error = residual(&starts, &rows, &scaled, x, b);
                        assert!(error < 1e-10, "{error}");
                    }
                }
            }
        }
    }

    #[test]
    fn refactorisation_is_that_from_scratch() {
        let (starts, rows, values) = laplacian(40, 0.01);
        for factorisation in BOTH {
            let mut kept = factor_of(&starts, &rows, factorisation);
            kept.factor(&values).unwrap();
            let mut changed = values.clone();
            // Diagonal entries here and there, then none, then all.
            for columns in [vec![0], vec![], vec![777, 780, 1599], (0..1600).collect()] {
                for column in columns {
                    changed[starts[column]] += 0.3;
                }
                kept.factor(&changed).unwrap();
                let mut fresh = factor_of(&starts, &rows, factorisation);
                fresh.factor(&changed).unwrap();
                assert_eq!(kept.factor, fresh.factor);
            }
        }
    }

    #[test]
    fn solves_again_after_a_failure() {
        let (starts, rows, values) = laplacian(20, 0.01);
        let mut indefinite = values.clone();
        indefinite[starts[210]] = -1.0;
        for factorisation in BOTH {
            let mut cholesky = factor_of(&starts, &rows, factorisation);
            cholesky.factor(&values).unwrap();
            let expected = cholesky.factor.clone();
            cholesky.factor(&indefinite).unwrap_err();
            cholesky.factor(&indefinite).unwrap_err();
            cholesky.factor(&values).unwrap();
            assert_eq!(cholesky.factor, expected);
        }
    }

    fn failing_vertex(outcome: Result<()>) -> usize {
        match outcome {
            Err(Error::NotPositiveDefinite { vertex, .. }) => vertex,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn indefinite_matrix_names_its_row() {
        // All else is positive definite, so that no other pivot can fail before.
        let (starts, rows, values) = laplacian(16, 0.01);
        // A full matrix is one block, wider than what the dense kernels take at once.
        let n = 150_usize;
        let full_starts: Vec<usize> = (0..=n)
            .map(|j| j * n - j * j.saturating_sub(1) / 2)
            .collect();
        let full_rows: Vec<u32> = (0..n as u32).flat_map(|j| j..n as u32).collect();
        let mut full_values = vec![0.1; full_rows.len()];
        for &start in &full_starts[..n] {
            full_values[start] = 2.0;
        }
        for (starts, rows, values) in [
            (starts, rows, values),
            (full_starts, full_rows, full_values),
        ] {
            for factorisation in BOTH {
                let mut cholesky = factor_of(&starts, &rows, factorisation);
                for row in 0..starts.len() - 1 {
                    for bad in [-1.0, 0.0, f64::NAN] {
                        let mut values = values.clone();
                        values[starts[row]] = bad;
                        assert_eq!(failing_vertex(cholesky.factor(&values)), row);
                    }
                }
            }
        }
    }
}
