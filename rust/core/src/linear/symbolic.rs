//! Symbolic Cholesky factorisation: the order of elimination, and where the factor has entries.
//!
//! Orders, elimination trees and patterns of factors are faer's.

use faer::dyn_stack::{MemStack, StackReq};
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::cholesky::simplicial::{
    SymbolicSimplicialCholesky, factorize_simplicial_symbolic_cholesky,
    factorize_simplicial_symbolic_cholesky_scratch, prefactorize_symbolic_cholesky,
    prefactorize_symbolic_cholesky_scratch,
};
use faer::sparse::linalg::cholesky::supernodal::{
    factorize_supernodal_symbolic_cholesky, factorize_supernodal_symbolic_cholesky_scratch,
};

use super::memory::{buffer, out_of_memory};
use super::ordering::{Graph, Ordering, minimum_degree, nested_dissection};
use super::supernodal::Supernodes;
use crate::error::Result;

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

/// The symbolic factorisation of all matrices of one sparsity pattern: what does not depend on
/// their values.
#[derive(Debug)]
pub struct SymbolicFactorisation {
    order: Vec<u32>,
    /// Place in the permuted triangle of each entry of the caller's pattern.
    pub(super) slots: Vec<u32>,
    pub(super) pattern: Pattern,
}

/// Where the entries of the factor are.
#[derive(Debug)]
pub(super) enum Pattern {
    Simplicial {
        symbolic: SymbolicSimplicialCholesky<u32>,
        upper: SymbolicSparseColMat<u32>,
    },
    Supernodal(Supernodes),
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

impl SymbolicFactorisation {
    /// Analyses the pattern of the lower triangle, by columns: the rows of column j, diagonal
    /// included, are `rows[column_starts[j]..column_starts[j + 1]]`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        column_starts: &[usize],
        rows: &[u32],
        ordering: Ordering,
        factorisation: Factorisation,
    ) -> Result<Self> {
        let n = column_starts.len() - 1;
        let graph = (ordering != Ordering::Given).then(|| Graph::new(column_starts, rows));
        let mut order = match &graph {
            None => (0..n as u32).collect(),
            Some(graph) => minimum_degree(graph)?,
        };
        let mut upper = permute(column_starts, rows, &order, Triangle::Upper);
        let mut counts = column_counts(&upper.pattern)?;
        if let (Some(graph), Ordering::LeastWork) = (&graph, ordering) {
            let other = nested_dissection(graph)?;
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
                pattern: Pattern::Supernodal(Supernodes::new(&symbolic, lower.pattern.as_ref())),
            })
        } else {
            let symbolic = factorize_simplicial_symbolic_cholesky(pattern, tree, &counts, stack)
                .map_err(|_| out_of_memory(n))?;
            Ok(Self {
                order,
                slots: upper.slots,
                pattern: Pattern::Simplicial {
                    symbolic,
                    upper: upper.pattern,
                },
            })
        }
    }

    /// Row that is eliminated at each step.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Number of rows.
    #[must_use]
    pub fn size(&self) -> usize {
        self.order.len()
    }

    /// Entries of the factor that are stored.
    #[must_use]
    pub fn factor_entries(&self) -> usize {
        match &self.pattern {
            Pattern::Simplicial { symbolic, .. } => symbolic.len_val(),
            Pattern::Supernodal(supernodes) => supernodes.factor_entries(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_dissection_saves_work_on_surfaces() {
        let (starts, rows, _) = crate::testing::laplacian(100, 0.0);
        let graph = Graph::new(&starts, &rows);
        let work_of = |order: &[u32]| {
            let upper = permute(&starts, &rows, order, Triangle::Upper);
            work(&column_counts(&upper.pattern).unwrap())
        };
        let dissected = work_of(&nested_dissection(&graph).unwrap());
        assert!(dissected < 0.8 * work_of(&minimum_degree(&graph).unwrap()));
    }
}
