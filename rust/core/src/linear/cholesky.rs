//! Sparse Cholesky factorisation: analyse once, refactor into the same buffers, solve.
//!
//! Orders, elimination trees, patterns of factors, the column-by-column factorisation and the dense
//! kernels are faer's; the factorisation by blocks is in `supernodal.rs`. All of it runs on one
//! thread: callers that have two systems factor them side by side. Only the first factorisation
//! on a thread and a solve with more right-hand sides than before allocate.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::cholesky::simplicial::{
    SimplicialLltRef, SymbolicSimplicialCholesky, factorize_simplicial_numeric_llt,
    factorize_simplicial_numeric_llt_scratch, factorize_simplicial_symbolic_cholesky,
    factorize_simplicial_symbolic_cholesky_scratch, prefactorize_symbolic_cholesky,
    prefactorize_symbolic_cholesky_scratch,
};
use faer::sparse::linalg::cholesky::supernodal::{
    factorize_supernodal_symbolic_cholesky, factorize_supernodal_symbolic_cholesky_scratch,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par};

use super::ordering::{Graph, minimum_degree, nested_dissection};
use super::supernodal::{Blocks, Supernodes};
use crate::error::{Error, Result, check_length};

/// Multiply-adds per entry of the factor above which dense blocks pay. Both factorisations take
/// the same time at 162 vertices of a sphere, blocks a half to a third of it from 642 on; faer's own
/// figure, for its own blocks, is 40.
const SUPERNODAL_RATIO: f64 = 10.0;

/// Which numeric factorisation to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Factorisation {
    /// By the ratio of arithmetic to entries.
    #[default]
    Automatic,
    /// Column by column.
    Simplicial,
    /// By dense blocks of columns.
    Supernodal,
}

/// How to find an order of elimination of little fill.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ordering {
    /// Approximate minimum degree, the quickest to find: for a matrix that is factored once.
    MinimumDegree,
    /// Approximate minimum degree or nested dissection, whichever takes less arithmetic: for a
    /// pattern that is factored many times.
    LeastWork,
}

/// The symbolic factorisation of all matrices of one sparsity pattern.
#[derive(Debug)]
pub struct Analysis {
    /// Row that is eliminated at each step.
    order: Vec<u32>,
    /// Place in the permuted triangle of each entry of the caller's pattern.
    slots: Vec<u32>,
    symbolic: Symbolic,
}

#[derive(Debug)]
enum Symbolic {
    Simplicial {
        symbolic: SymbolicSimplicialCholesky<u32>,
        upper: SymbolicSparseColMat<u32>,
    },
    Supernodal(Supernodes),
}

/// The Cholesky factor A = L L^T of symmetric positive definite matrices of one sparsity
/// pattern. Factors of the same pattern share its analysis.
pub struct Cholesky {
    analysis: Arc<Analysis>,
    /// Values of the permuted triangle.
    values: Vec<f64>,
    factor: Vec<f64>,
    /// Right-hand sides, then solutions, in the order of elimination.
    permuted: Vec<f64>,
    blocks: Blocks,
    stack: MemBuffer,
}

/// One triangle of the permuted matrix, rows ascending, and the place there of each entry of the
/// caller's lower triangle.
struct Permuted {
    pattern: SymbolicSparseColMat<u32>,
    slots: Vec<u32>,
}

#[derive(Clone, Copy)]
enum Triangle {
    Lower,
    Upper,
}

impl Analysis {
    /// Analyses the pattern of the lower triangle, by columns: the rows of column j, diagonal
    /// included, are `rows[column_starts[j]..column_starts[j + 1]]`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(
        column_starts: &[usize],
        rows: &[u32],
        ordering: Ordering,
        factorisation: Factorisation,
    ) -> Result<Self> {
        let n = column_starts.len() - 1;
        let graph = Graph::new(column_starts, rows);
        let mut order = minimum_degree(&graph)?;
        let mut upper = permute(column_starts, rows, &order, Triangle::Upper);
        let mut counts = column_counts(&upper.pattern)?;
        if ordering == Ordering::LeastWork {
            let other = nested_dissection(&graph)?;
            let other_upper = permute(column_starts, rows, &other, Triangle::Upper);
            let other_counts = column_counts(&other_upper.pattern)?;
            if work(&other_counts) < work(&counts) {
                (order, upper, counts) = (other, other_upper, other_counts);
            }
        }
        let supernodal = match factorisation {
            Factorisation::Automatic => {
                let entries: f64 = counts.iter().map(|&count| f64::from(count)).sum();
                work(&counts) > SUPERNODAL_RATIO * entries
            }
            Factorisation::Simplicial => false,
            Factorisation::Supernodal => true,
        };
        let mut memory = buffer(
            n,
            StackReq::any_of(&[
                prefactorize_symbolic_cholesky_scratch::<u32>(n, rows.len()),
                factorize_simplicial_symbolic_cholesky_scratch::<u32>(n),
                factorize_supernodal_symbolic_cholesky_scratch::<u32>(n),
            ]),
        )?;
        let stack = MemStack::new(&mut memory);
        let mut parents = vec![0; n];
        let pattern = upper.pattern.as_ref();
        let tree = prefactorize_symbolic_cholesky(&mut parents, &mut counts, pattern, stack);
        if supernodal {
            let symbolic = factorize_supernodal_symbolic_cholesky(
                pattern,
                tree,
                &counts,
                stack,
                Default::default(),
            )
            .map_err(|_| out_of_memory(n))?;
            let lower = permute(column_starts, rows, &order, Triangle::Lower);
            Ok(Self {
                order,
                slots: lower.slots,
                symbolic: Symbolic::Supernodal(Supernodes::new(&symbolic, lower.pattern.as_ref())),
            })
        } else {
            let symbolic = factorize_simplicial_symbolic_cholesky(pattern, tree, &counts, stack)
                .map_err(|_| out_of_memory(n))?;
            Ok(Self {
                order,
                slots: upper.slots,
                symbolic: Symbolic::Simplicial {
                    symbolic,
                    upper: upper.pattern,
                },
            })
        }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.order.len()
    }

    /// Entries of the factor that are stored.
    pub fn factor_entries(&self) -> usize {
        match &self.symbolic {
            Symbolic::Simplicial { symbolic, .. } => symbolic.len_val(),
            Symbolic::Supernodal(supernodes) => supernodes.factor_entries(),
        }
    }
}

fn permute(column_starts: &[usize], rows: &[u32], order: &[u32], triangle: Triangle) -> Permuted {
    let n = order.len();
    let mut step = vec![0_u32; n];
    for (k, &row) in order.iter().enumerate() {
        step[row as usize] = k as u32;
    }
    let mut entries = Vec::with_capacity(rows.len());
    for j in 0..n {
        for e in column_starts[j]..column_starts[j + 1] {
            let (a, b) = (step[rows[e] as usize], step[j]);
            let (low, high) = (a.min(b), a.max(b));
            entries.push(match triangle {
                Triangle::Lower => (low, high, e),
                Triangle::Upper => (high, low, e),
            });
        }
    }
    entries.sort_unstable();
    let mut starts = vec![0_u32; n + 1];
    let mut slots = vec![0; rows.len()];
    for (slot, &(column, _, e)) in entries.iter().enumerate() {
        starts[column as usize + 1] = slot as u32 + 1;
        slots[e] = slot as u32;
    }
    let rows = entries.iter().map(|&(_, row, _)| row).collect();
    Permuted {
        pattern: SymbolicSparseColMat::new_checked(n, n, starts, None, rows),
        slots,
    }
}

/// Entries of each column of the factor, by the upper triangle of the matrix.
fn column_counts(upper: &SymbolicSparseColMat<u32>) -> Result<Vec<u32>> {
    let n = upper.ncols();
    let mut memory = buffer(
        n,
        prefactorize_symbolic_cholesky_scratch::<u32>(n, upper.row_idx().len()),
    )?;
    let (mut parents, mut counts) = (vec![0; n], vec![0; n]);
    let stack = MemStack::new(&mut memory);
    prefactorize_symbolic_cholesky(&mut parents, &mut counts, upper.as_ref(), stack);
    Ok(counts)
}

/// Multiply-adds of a factorisation.
fn work(counts: &[u32]) -> f64 {
    counts
        .iter()
        .map(|&count| 0.5 * f64::from(count) * (f64::from(count) + 1.0))
        .sum()
}

pub(super) fn buffer(size: usize, request: StackReq) -> Result<MemBuffer> {
    MemBuffer::try_new(request).map_err(|_| out_of_memory(size))
}

pub(super) fn out_of_memory(size: usize) -> Error {
    Error::OutOfMemory {
        argument: "matrix",
        size,
        unit: "unknowns",
    }
}

impl Cholesky {
    /// Makes the buffers of one factor.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(analysis: Arc<Analysis>) -> Result<Self> {
        let n = analysis.size();
        let (blocks, request) = match &analysis.symbolic {
            Symbolic::Simplicial { .. } => (
                Blocks::default(),
                factorize_simplicial_numeric_llt_scratch::<u32, f64>(n),
            ),
            Symbolic::Supernodal(supernodes) => (supernodes.blocks(), supernodes.scratch()),
        };
        Ok(Self {
            values: vec![0.0; analysis.slots.len()],
            factor: vec![0.0; analysis.factor_entries()],
            permuted: vec![0.0; n],
            blocks,
            stack: buffer(n, request)?,
            analysis,
        })
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.analysis.size()
    }

    /// Factors the matrix with these lower-triangle values, in the order of the caller's pattern.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names the row whose pivot is not a positive number.
    pub fn factor(&mut self, values: &[f64]) -> Result<()> {
        let analysis = &*self.analysis;
        check_length("values", values.len(), analysis.slots.len())?;
        let stack = MemStack::new(&mut self.stack);
        let placed = values.iter().zip(&analysis.slots);
        let outcome = match &analysis.symbolic {
            Symbolic::Simplicial { symbolic, upper } => {
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
            Symbolic::Supernodal(supernodes) => {
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
            size: analysis.size(),
            vertex: analysis.order[step] as usize,
        })
    }

    /// Solves A X = B in place; the columns of B stand one after the other in `columns`.
    ///
    /// # Errors
    /// [`Error::Length`] where `columns` is no multiple of the size.
    pub fn solve(&mut self, columns: &mut [f64]) -> Result<()> {
        let analysis = &*self.analysis;
        let size = analysis.size();
        let n_columns = columns.len() / size;
        check_length("columns", columns.len(), n_columns * size)?;
        if columns.len() > self.permuted.len() {
            self.permuted.resize(columns.len(), 0.0);
        }
        let permuted = &mut self.permuted[..columns.len()];
        for (to, from) in permuted.chunks_mut(size).zip(columns.chunks(size)) {
            for (value, &row) in to.iter_mut().zip(&analysis.order) {
                *value = from[row as usize];
            }
        }
        match &analysis.symbolic {
            Symbolic::Simplicial { symbolic, .. } => SimplicialLltRef::new(symbolic, &self.factor)
                .solve_in_place_with_conj(
                    Conj::No,
                    MatMut::from_column_major_slice_mut(permuted, size, n_columns),
                    Par::Seq,
                    MemStack::new(&mut self.stack),
                ),
            Symbolic::Supernodal(supernodes) => {
                supernodes.solve(&self.factor, permuted, &mut self.blocks);
            }
        }
        for (from, to) in self.permuted.chunks(size).zip(columns.chunks_mut(size)) {
            for (&value, &row) in from.iter().zip(&analysis.order) {
                to[row as usize] = value;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lower triangle of the five-point Laplacian plus `shift` on a k x k grid.
    fn laplacian(k: usize, shift: f64) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..k * k {
            rows.push(j as u32);
            values.push(4.0 + shift);
            if (j + 1) % k != 0 {
                rows.push(j as u32 + 1);
                values.push(-1.0);
            }
            if j + k < k * k {
                rows.push((j + k) as u32);
                values.push(-1.0);
            }
            starts.push(rows.len());
        }
        (starts, rows, values)
    }

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
        let analysis = Analysis::new(starts, rows, Ordering::LeastWork, factorisation).unwrap();
        Cholesky::new(Arc::new(analysis)).unwrap()
    }

    #[test]
    fn both_factorisations_solve() {
        let (starts, rows, values) = laplacian(30, 0.01);
        for factorisation in BOTH {
            for ordering in [Ordering::MinimumDegree, Ordering::LeastWork] {
                let analysis = Analysis::new(&starts, &rows, ordering, factorisation).unwrap();
                let mut cholesky = Cholesky::new(Arc::new(analysis)).unwrap();
                for (scale, n_columns) in [(1.0, 1), (3.0, 3), (0.1, 2)] {
                    let scaled: Vec<f64> = values.iter().map(|v| v * scale).collect();
                    cholesky.factor(&scaled).unwrap();
                    let b: Vec<f64> = (0..n_columns * 900)
                        .map(|i| (i as f64 * 0.37).sin())
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

    #[test]
    fn nested_dissection_saves_work_on_surfaces() {
        let (starts, rows, _) = laplacian(100, 0.0);
        let graph = Graph::new(&starts, &rows);
        let work_of = |order: &[u32]| {
            let upper = permute(&starts, &rows, order, Triangle::Upper);
            work(&column_counts(&upper.pattern).unwrap())
        };
        let dissected = work_of(&nested_dissection(&graph).unwrap());
        assert!(dissected < 0.8 * work_of(&minimum_degree(&graph).unwrap()));
    }
}
