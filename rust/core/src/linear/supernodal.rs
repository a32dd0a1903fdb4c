//! Numeric supernodal Cholesky factorisation, left-looking (Ng and Peyton 1993), that leaves alone
//! what has not changed.
//!
//! A supernode is a block of consecutive columns of the factor with the same rows below the
//! block. Its values depend on those of the matrix in its own subtree of the elimination tree and on
//! nothing else, so a block without a changed value in its subtree is already factored: the same
//! numbers as of a factorisation from scratch, bit by bit.

use faer::dyn_stack::{MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Accum, MatMut, MatRef, Par};

/// The blocks of a factor. The values of a block stand by columns, each with the rows of the block
/// and the rows below it.
#[derive(Debug)]
pub(super) struct Supernodes {
    /// First column of each block, and the number of columns.
    starts: Vec<u32>,
    /// First of `rows` of each block.
    row_starts: Vec<u32>,
    /// Rows below each block, ascending.
    rows: Vec<u32>,
    /// First value of each block.
    value_starts: Vec<usize>,
    /// First of `updates` of each block.
    update_starts: Vec<u32>,
    updates: Vec<Update>,
    /// Block of each entry of the matrix.
    block_of_slot: Vec<u32>,
    /// Place among the values of the factor of each entry of the matrix.
    places: Vec<usize>,
    /// First entry of the matrix of each block.
    slot_starts: Vec<u32>,
}

/// An earlier block that has rows within the columns of a later one.
#[derive(Debug)]
struct Update {
    block: u32,
    /// These rows, by their position among the rows below the earlier block.
    from: u32,
    to: u32,
}

/// The state of the blocks of one factor, and buffers.
#[derive(Default)]
pub(super) struct Blocks {
    /// Blocks with a changed value in their subtree.
    changed: Vec<bool>,
    /// Position of the rows of the matrix in the current block.
    position: Vec<u32>,
    /// Positions in the current block of the rows of an earlier one.
    targets: Vec<u32>,
    product: Vec<f64>,
    /// Right-hand side in the rows of the current block.
    local: Vec<f64>,
}

impl Supernodes {
    /// Takes the symbolic factorisation of a matrix and the pattern of its lower triangle.
    pub(super) fn new(
        symbolic: &SymbolicSupernodalCholesky<u32>,
        lower: SymbolicSparseColMatRef<'_, u32>,
    ) -> Self {
        let count = symbolic.n_supernodes();
        let n = symbolic.nrows();
        let mut starts = symbolic.supernode_begin().to_vec();
        starts.push(n as u32);
        let mut block_of_column = vec![0_u32; n];
        let (mut row_starts, mut rows) = (vec![0], Vec::new());
        let mut value_starts = vec![0];
        for s in 0..count {
            let columns = starts[s] as usize..starts[s + 1] as usize;
            block_of_column[columns.clone()].fill(s as u32);
            let below = symbolic.supernode(s).pattern();
            rows.extend_from_slice(below);
            row_starts.push(rows.len() as u32);
            value_starts.push(value_starts[s] + columns.len() * (columns.len() + below.len()));
        }

        let mut lists: Vec<Vec<Update>> = (0..count).map(|_| Vec::new()).collect();
        for d in 0..count {
            let below = &rows[row_starts[d] as usize..row_starts[d + 1] as usize];
            let mut from = 0;
            while from < below.len() {
                let target = block_of_column[below[from] as usize];
                let inside = below[from..]
                    .iter()
                    .take_while(|&&row| block_of_column[row as usize] == target);
                let to = from + inside.count();
                lists[target as usize].push(Update {
                    block: d as u32,
                    from: from as u32,
                    to: to as u32,
                });
                from = to;
            }
        }
        let mut update_starts = vec![0];
        let mut updates = Vec::new();
        for list in lists {
            updates.extend(list);
            update_starts.push(updates.len() as u32);
        }

        let mut places = Vec::with_capacity(lower.row_idx().len());
        let mut block_of_slot = Vec::with_capacity(lower.row_idx().len());
        let mut slot_starts = vec![0];
        for s in 0..count {
            let (start, end) = (starts[s] as usize, starts[s + 1] as usize);
            let below = &rows[row_starts[s] as usize..row_starts[s + 1] as usize];
            let height = end - start + below.len();
            for j in start..end {
                for row in lower.row_idx_of_col(j) {
                    let i = if row < end {
                        row - start
                    } else {
                        end - start + below.partition_point(|&b| (b as usize) < row)
                    };
                    places.push(value_starts[s] + (j - start) * height + i);
                    block_of_slot.push(s as u32);
                }
            }
            slot_starts.push(places.len() as u32);
        }
        Self {
            starts,
            row_starts,
            rows,
            value_starts,
            update_starts,
            updates,
            block_of_slot,
            places,
            slot_starts,
        }
    }

    fn count(&self) -> usize {
        self.starts.len() - 1
    }

    pub(super) fn factor_entries(&self) -> usize {
        self.value_starts[self.count()]
    }

    fn width(&self, s: usize) -> usize {
        (self.starts[s + 1] - self.starts[s]) as usize
    }

    fn below(&self, s: usize) -> &[u32] {
        &self.rows[self.row_starts[s] as usize..self.row_starts[s + 1] as usize]
    }

    /// The state before the first factorisation.
    pub(super) fn blocks(&self) -> Blocks {
        let tallest = (0..self.count())
            .map(|s| self.width(s) + self.below(s).len())
            .max()
            .unwrap_or(0);
        let largest_product = self
            .updates
            .iter()
            .map(|update| {
                let below = self.below(update.block as usize).len();
                (below - update.from as usize) * (update.to - update.from) as usize
            })
            .max()
            .unwrap_or(0);
        Blocks {
            changed: vec![true; self.count()],
            position: vec![0; self.starts[self.count()] as usize],
            targets: vec![0; tallest],
            product: vec![0.0; largest_product],
            local: vec![0.0; tallest],
        }
    }

    /// Memory that [`Self::factor`] takes for its dense kernels.
    pub(super) fn scratch(&self) -> StackReq {
        let widest = (0..self.count()).map(|s| self.width(s)).max().unwrap_or(0);
        cholesky_in_place_scratch::<f64>(widest, Par::Seq, Default::default())
    }

    /// Notes that an entry of the matrix has another value than before.
    pub(super) fn mark_changed(&self, slot: usize, blocks: &mut Blocks) {
        blocks.changed[self.block_of_slot[slot] as usize] = true;
    }

    /// Factors what depends on values that have changed. A failure names the column.
    pub(super) fn factor(
        &self,
        values: &[f64],
        factor: &mut [f64],
        blocks: &mut Blocks,
        stack: &mut MemStack,
    ) -> Result<(), usize> {
        for s in 0..self.count() {
            if !blocks.changed[s] {
                continue;
            }
            let (head, tail) = factor.split_at_mut(self.value_starts[s]);
            let block = &mut tail[..self.value_starts[s + 1] - self.value_starts[s]];
            let outcome = self.factor_block(s, values, head, block, blocks, stack);
            if let Err(column) = outcome {
                // What has not been reached does not belong to these values.
                blocks.changed.fill(true);
                return Err(column);
            }
            if let Some(&row) = self.below(s).first() {
                // The parent in the elimination tree holds the first row below.
                let parent = self.starts.partition_point(|&start| start <= row) - 1;
                blocks.changed[parent] = true;
            }
        }
        blocks.changed.fill(false);
        Ok(())
    }

    fn factor_block(
        &self,
        s: usize,
        values: &[f64],
        head: &[f64],
        block: &mut [f64],
        blocks: &mut Blocks,
        stack: &mut MemStack,
    ) -> Result<(), usize> {
        let start = self.starts[s] as usize;
        let width = self.width(s);
        let below = self.below(s);
        let height = width + below.len();
        block.fill(0.0);
        for slot in self.slot_starts[s] as usize..self.slot_starts[s + 1] as usize {
            block[self.places[slot] - self.value_starts[s]] = values[slot];
        }
        for (i, &row) in below.iter().enumerate() {
            blocks.position[row as usize] = (width + i) as u32;
        }
        for i in 0..width {
            blocks.position[start + i] = i as u32;
        }
        let updates = self.update_starts[s] as usize..self.update_starts[s + 1] as usize;
        for update in &self.updates[updates] {
            let d = update.block as usize;
            let (from, to) = (update.from as usize, update.to as usize);
            let d_below = self.below(d);
            let d_width = self.width(d);
            let d_height = d_width + d_below.len();
            let earlier = MatRef::from_column_major_slice(
                &head[self.value_starts[d]..self.value_starts[d + 1]],
                d_height,
                d_width,
            );
            let left = earlier.subrows(d_width + from, d_below.len() - from);
            let right = earlier.subrows(d_width + from, to - from);
            let (m, w) = (left.nrows(), right.nrows());
            let product = &mut blocks.product[..m * w];
            matmul(
                MatMut::from_column_major_slice_mut(&mut *product, m, w),
                Accum::Replace,
                left,
                right.transpose(),
                1.0,
                Par::Seq,
            );
            let targets = &mut blocks.targets[..m];
            for (target, &row) in targets.iter_mut().zip(&d_below[from..]) {
                *target = blocks.position[row as usize];
            }
            for (j, column) in product.chunks_exact(m).enumerate() {
                let target = &mut block[targets[j] as usize * height..][..height];
                for (&i, &x) in targets[j..].iter().zip(&column[j..]) {
                    target[i as usize] -= x;
                }
            }
        }
        let (mut top, bottom) =
            MatMut::from_column_major_slice_mut(block, height, width).split_at_row_mut(width);
        cholesky_in_place(
            top.as_mut(),
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        )
        .map_err(|LltError::NonPositivePivot { index }| start + index)?;
        solve_lower_triangular_in_place(top.as_ref(), bottom.transpose_mut(), Par::Seq);
        Ok(())
    }

    /// Solves with the factor and its transpose in place, for right-hand sides in the order of
    /// elimination, one after the other in `columns`.
    pub(super) fn solve(&self, factor: &[f64], columns: &mut [f64], blocks: &mut Blocks) {
        let n = self.starts[self.count()] as usize;
        for s in 0..self.count() {
            let (start, width, below) = (self.starts[s] as usize, self.width(s), self.below(s));
            let height = width + below.len();
            let block = &factor[self.value_starts[s]..self.value_starts[s + 1]];
            for x in columns.chunks_exact_mut(n) {
                // Nothing to subtract: so it is in all of the other phase.
                if x[start..start + width].iter().all(|&value| value == 0.0) {
                    continue;
                }
                let y = &mut blocks.local[..height];
                gather(x, start, width, below, y);
                for (j, column) in block.chunks_exact(height).enumerate() {
                    let solved = y[j] / column[j];
                    y[j] = solved;
                    for (target, value) in y[j + 1..].iter_mut().zip(&column[j + 1..]) {
                        *target -= solved * value;
                    }
                }
                x[start..start + width].copy_from_slice(&y[..width]);
                for (&row, &value) in below.iter().zip(&y[width..]) {
                    x[row as usize] = value;
                }
            }
        }
        for s in (0..self.count()).rev() {
            let (start, width, below) = (self.starts[s] as usize, self.width(s), self.below(s));
            let height = width + below.len();
            let block = &factor[self.value_starts[s]..self.value_starts[s + 1]];
            for x in columns.chunks_exact_mut(n) {
                let y = &mut blocks.local[..height];
                gather(x, start, width, below, y);
                for (j, column) in block.chunks_exact(height).enumerate().rev() {
                    y[j] = (y[j] - dot(&column[j + 1..], &y[j + 1..])) / column[j];
                }
                x[start..start + width].copy_from_slice(&y[..width]);
            }
        }
    }
}

/// The rows of a block and the rows below it.
fn gather(x: &[f64], start: usize, width: usize, below: &[u32], y: &mut [f64]) {
    let (top, bottom) = y.split_at_mut(width);
    top.copy_from_slice(&x[start..start + width]);
    for (value, &row) in bottom.iter_mut().zip(below) {
        *value = x[row as usize];
    }
}

/// Sum of products with eight partial sums, which vector instructions can hold.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a_chunks, b_chunks) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a_chunks
        .remainder()
        .iter()
        .zip(b_chunks.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}
