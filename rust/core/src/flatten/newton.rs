//! Newton systems of maps to the plane: symmetric matrices of blocks of two rows.

use std::sync::Arc;

use super::dirichlet::Matrix2;
use super::polygon::Point;
use crate::error::Result;
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};

/// Added to the diagonal, as translations and rotations cost nothing, relative to each entry; more
/// where rounding spoils the factorisation.
const SHIFTS: [f64; 4] = [1e-12, 1e-9, 1e-6, 1e-3];

/// Which points share a block of the matrix.
struct Pattern {
    /// Pairs of points, lower number first; sorted.
    pairs: Vec<(u32, u32)>,
    /// Where the pairs of each point begin.
    starts: Vec<usize>,
}

/// The lower triangle of the matrix by columns, and the right-hand side, in the unknowns 2 v and
/// 2 v + 1 of each point v.
#[derive(Clone)]
pub(super) struct Sums {
    pattern: Arc<Pattern>,
    values: Vec<f64>,
    right: Vec<f64>,
}

/// A system and the factor of its matrix.
pub(super) struct System {
    pub sums: Sums,
    cholesky: Cholesky,
}

/// A step, and the slope of the energy in its direction.
pub(super) struct Step {
    pub direction: Vec<Point>,
    pub slope: f64,
}

impl System {
    /// A system of `n` points with blocks for these pairs, in any order.
    pub fn new(n: usize, mut pairs: Vec<(u32, u32)>) -> Result<Self> {
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; n + 1];
        for (i, pair) in pairs.iter().enumerate() {
            starts[pair.0 as usize + 1] = i + 1;
        }
        for v in 0..n {
            starts[v + 1] = starts[v + 1].max(starts[v]);
        }
        let mut column_starts = vec![0];
        let mut rows = Vec::with_capacity(4 * pairs.len() + 3 * n);
        for v in 0..n {
            for axis in 0..2 {
                rows.extend((axis..2).map(|r| (2 * v + r) as u32));
                for pair in &pairs[starts[v]..starts[v + 1]] {
                    rows.extend([2 * pair.1, 2 * pair.1 + 1]);
                }
                column_starts.push(rows.len());
            }
        }
        let symbolic = SymbolicFactorisation::new(
            &column_starts,
            &rows,
            Ordering::MinimumDegree,
            Factorisation::Automatic,
        )?;
        Ok(Self {
            sums: Sums {
                values: vec![0.0; rows.len()],
                right: vec![0.0; 2 * n],
                pattern: Arc::new(Pattern { pairs, starts }),
            },
            cholesky: Cholesky::new(Arc::new(symbolic))?,
        })
    }

    /// The Newton step; [`None`] at rest, or where no shift makes the matrix definite.
    pub fn step(&mut self) -> Option<Step> {
        let sums = &mut self.sums;
        let n = sums.right.len();
        let diagonal: Vec<usize> = (0..n).map(|i| sums.column(i / 2, i % 2)).collect();
        let values: Vec<f64> = diagonal.iter().map(|&place| sums.values[place]).collect();
        for shift in SHIFTS {
            for (&place, value) in diagonal.iter().zip(&values) {
                sums.values[place] = value * (1.0 + shift);
            }
            if self.cholesky.factor(&sums.values).is_err() {
                continue;
            }
            let mut direction = sums.right.clone();
            self.cholesky.solve(&mut direction).ok()?;
            let slope = -direction
                .iter()
                .zip(&sums.right)
                .map(|(d, r)| d * r)
                .sum::<f64>();
            if slope < 0.0 && slope.is_finite() {
                return Some(Step {
                    direction: direction.as_chunks().0.to_vec(),
                    slope,
                });
            }
        }
        None
    }
}

impl Sums {
    /// The place of the block of two points.
    pub fn place(&self, a: u32, b: u32) -> Option<usize> {
        let pair = ordered(a, b);
        let Pattern { pairs, starts } = &*self.pattern;
        let row = starts[pair.0 as usize]..starts[pair.0 as usize + 1];
        let first = row.start;
        pairs[row].binary_search(&pair).ok().map(|k| first + k)
    }

    /// Sets all to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
        self.right.fill(0.0);
    }

    /// Place of the first value of column 2 v + axis.
    fn column(&self, v: usize, axis: usize) -> usize {
        let first = 3 * v + 4 * self.pattern.starts[v];
        let count = self.pattern.starts[v + 1] - self.pattern.starts[v];
        first + axis * (2 + 2 * count)
    }

    /// Adds to the gradient at a point.
    pub fn add_gradient(&mut self, v: u32, gradient: Point) {
        let right = &mut self.right[2 * v as usize..][..2];
        for (value, slope) in right.iter_mut().zip(gradient) {
            *value -= slope;
        }
    }

    /// Adds the block of a point with itself.
    pub fn add_diagonal(&mut self, v: u32, block: Matrix2) {
        let (x, y) = (self.column(v as usize, 0), self.column(v as usize, 1));
        self.values[x] += block[0][0];
        self.values[x + 1] += block[1][0];
        self.values[y] += block[1][1];
    }

    /// Adds the block (a, b) that stands at place `pair`.
    pub fn add_pair(&mut self, pair: usize, a: u32, b: u32, block: Matrix2) {
        let v = a.min(b) as usize;
        let k = pair - self.pattern.starts[v];
        // Rows of the lower triangle belong to the higher point.
        let block = if a < b { block } else { transposed(block) };
        for (axis, row) in block.iter().enumerate() {
            let place = self.column(v, axis) + 2 - axis + 2 * k;
            for (value, added) in self.values[place..place + 2].iter_mut().zip(row) {
                *value += added;
            }
        }
    }

    /// Adds another system of the same pattern.
    pub fn add(&mut self, other: &Self) {
        for (mine, others) in [
            (&mut self.values, &other.values),
            (&mut self.right, &other.right),
        ] {
            for (value, added) in mine.iter_mut().zip(others) {
                *value += added;
            }
        }
    }
}

fn transposed([[a, b], [c, d]]: Matrix2) -> Matrix2 {
    [[a, c], [b, d]]
}

pub(super) fn ordered(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}
