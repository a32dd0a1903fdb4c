//! A turned piece on the grid: the cells that it touches and those nearer to it than the gap.

use super::piece::{Piece, bounds, turn};

type Point = [f64; 2];

/// Rounding moves what is drawn by far less, in cells.
const SLACK: f64 = 1e-7;
/// Low corner of a piece in its cell: what is drawn around it does not touch the cell before.
const CORNER: f64 = 1e-6;

/// Cells along the side of a block.
pub(super) const BLOCK: usize = 4;

/// Cells `start..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Run {
    pub(super) row: i32,
    pub(super) start: i32,
    pub(super) end: i32,
}

/// A piece turned and scaled, its low corner in the cell (0, 0).
#[derive(Debug)]
pub(super) struct Mask {
    pub(super) cosine: f64,
    pub(super) sine: f64,
    /// What is added to a turned and scaled point.
    pub(super) shift: Point,
    /// Upper right corner of what is drawn.
    pub(super) high: Point,
    /// Cells along x and y that it touches.
    pub(super) width: usize,
    pub(super) height: usize,
    /// Centre of the cells that it touches.
    pub(super) centre: Point,
    /// Masks of one kind touch the same cells.
    pub(super) kind: usize,
    /// The cells that it touches.
    pub(super) touched: Vec<Run>,
    /// Blocks of cells that it fills, whatever the place of its low corner in its block.
    pub(super) inner: Vec<Run>,
    /// The cells nearer to it than the gap, itself included.
    pub(super) near: Vec<Run>,
}

impl Mask {
    pub(super) fn new(piece: &Piece, angle: f64, scale: f64, gap: f64) -> Self {
        let (sine, cosine) = angle.sin_cos();
        let [low, high] = bounds(piece.hull(), angle);
        let shift = low.map(|x| CORNER - scale * x);
        let drawn = |point| {
            let [x, y] = turn(point, cosine, sine);
            [scale * x + shift[0], scale * y + shift[1]]
        };
        let high = [0, 1].map(|k| scale * high[k] + shift[k]);
        let [width, height] = high.map(|x| (x + SLACK).floor() as usize + 1);
        let margin = (gap + SLACK).ceil() as usize;

        let mut touched = Canvas::new(width, height, 0);
        for corners in piece.triangles() {
            touched.fill(corners.map(drawn));
        }
        let mut near = Canvas::new(width + 2 * margin, height + 2 * margin, margin);
        for ends in piece.outline() {
            let ends = ends.map(drawn);
            touched.stroke(ends, SLACK);
            near.stroke(ends, gap + SLACK);
        }
        near.add(&touched);
        let mut inner = touched.inner();
        let mut touched = touched.runs();
        let mut centre = [0.0; 2];
        let mut count = 0.0;
        for run in &touched {
            let length = f64::from(run.end - run.start);
            count += length;
            centre[0] += length * 0.5 * f64::from(run.start + run.end);
            centre[1] += length * (f64::from(run.row) + 0.5);
        }
        // Rows far apart tell more than neighbours: halves, quarters and so on.
        for runs in [&mut touched, &mut inner] {
            runs.sort_by_key(|run| run.row.reverse_bits().cast_unsigned());
        }
        Self {
            cosine,
            sine,
            shift,
            high,
            width,
            height,
            centre: centre.map(|x| x / count),
            kind: 0,
            touched,
            inner,
            near: near.runs(),
        }
    }
}

/// Rows of bits around the cell (0, 0).
struct Canvas {
    words: usize,
    height: usize,
    /// Cells to the left of and below the cell (0, 0).
    margin: i32,
    bits: Vec<u64>,
}

impl Canvas {
    fn new(width: usize, height: usize, margin: usize) -> Self {
        let words = width.div_ceil(64);
        Self {
            words,
            height,
            margin: margin as i32,
            bits: vec![0; words * height],
        }
    }

    /// Sets the cells of a row from the one that holds `left` to the one that holds `right`.
    fn span(&mut self, row: i32, left: f64, right: f64) {
        let last = (64 * self.words) as i32 - 1;
        let row = (row + self.margin) as usize;
        let start = (left.floor() as i32 + self.margin).clamp(0, last) as usize;
        let end = (right.floor() as i32 + self.margin).clamp(0, last) as usize;
        let words = &mut self.bits[row * self.words..(row + 1) * self.words];
        set(words, start, end + 1);
    }

    /// Rows that hold something between two heights.
    fn rows(&self, low: f64, high: f64) -> std::ops::RangeInclusive<i32> {
        let last = self.height as i32 - 1 - self.margin;
        let clamped = |y: f64| (y.floor() as i32).clamp(-self.margin, last);
        clamped(low)..=clamped(high)
    }

    /// Sets the cells whose centres a triangle holds.
    fn fill(&mut self, corners: [Point; 3]) {
        let heights = corners.map(|corner| corner[1]);
        let low = heights.into_iter().fold(f64::INFINITY, f64::min);
        let high = heights.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let first = (low - 0.5 - SLACK).ceil() as i32;
        let last = (high - 0.5 + SLACK).floor() as i32;
        for row in first..=last {
            let y = (f64::from(row) + 0.5).clamp(low, high);
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if let Some(x) = crossing(a, b, y) {
                    left = left.min(x);
                    right = right.max(x);
                }
            }
            let (left, right) = (
                (left - 0.5 - SLACK).ceil() + 0.5,
                (right - 0.5 + SLACK).floor() + 0.5,
            );
            if left <= right {
                self.span(row, left, right);
            }
        }
    }

    /// Sets the cells that are not further than `radius` from a segment.
    fn stroke(&mut self, ends: [Point; 2], radius: f64) {
        let [a, b] = ends;
        let rows = self.rows(a[1].min(b[1]) - radius, a[1].max(b[1]) + radius);
        let mirrored = [[-a[0], a[1]], [-b[0], b[1]]];
        for row in rows {
            let left = -rightmost(mirrored, radius, row);
            let right = rightmost(ends, radius, row);
            if left <= right {
                self.span(row, left, right);
            }
        }
    }

    /// Sets the cells that are set in a canvas without margin.
    fn add(&mut self, other: &Self) {
        for run in other.runs() {
            self.span(run.row, f64::from(run.start), f64::from(run.end) - 0.5);
        }
    }

    /// The cells that are set, row by row.
    fn runs(&self) -> Vec<Run> {
        let mut found = Vec::new();
        for row in 0..self.height {
            for (start, end) in runs(self.row(row)) {
                found.push(Run {
                    row: row as i32 - self.margin,
                    start: start as i32 - self.margin,
                    end: end as i32 - self.margin,
                });
            }
        }
        found
    }

    /// The blocks that are set wherever the cell (0, 0) lies in its block: with them, all cells
    /// less than a block before them.
    fn inner(&self) -> Vec<Run> {
        let mut found = Vec::new();
        let before = BLOCK - 1;
        for row in (BLOCK..)
            .step_by(BLOCK)
            .take_while(|row| row + before < self.height)
        {
            let mut common = self.row(row - before).to_vec();
            for other in row - before + 1..=row + before {
                for (word, other) in common.iter_mut().zip(self.row(other)) {
                    *word &= other;
                }
            }
            for (start, end) in runs(&common) {
                let (start, end) = ((start + before).div_ceil(BLOCK), end / BLOCK);
                if start < end {
                    found.push(Run {
                        row: (row / BLOCK) as i32,
                        start: start as i32,
                        end: end as i32,
                    });
                }
            }
        }
        found
    }

    fn row(&self, row: usize) -> &[u64] {
        &self.bits[row * self.words..(row + 1) * self.words]
    }
}

/// Starts and ends of the runs of bits that are set.
pub(super) fn runs(words: &[u64]) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(start) = next(words, at, 0) {
        at = next(words, start, u64::MAX).unwrap_or(64 * words.len());
        found.push((start, at));
    }
    found
}

/// Sets the bits `start..end`.
pub(super) fn set(words: &mut [u64], start: usize, end: usize) {
    for (index, word) in words
        .iter_mut()
        .enumerate()
        .take(end.div_ceil(64))
        .skip(start / 64)
    {
        let from = start.saturating_sub(64 * index);
        let to = (end - 64 * index).min(64);
        *word |= (u64::MAX << from) & (u64::MAX >> (64 - to));
    }
}

/// The first bit at or after `from` that is set once the words are combined with `flip` by exclusive or.
fn next(words: &[u64], from: usize, flip: u64) -> Option<usize> {
    let mut index = from / 64;
    let mut word = (words.get(index)? ^ flip) & (u64::MAX << (from % 64));
    while word == 0 {
        index += 1;
        word = words.get(index)? ^ flip;
    }
    Some(64 * index + word.trailing_zeros() as usize)
}

/// Where a segment meets a height, if it does.
fn crossing(a: Point, b: Point, y: f64) -> Option<f64> {
    let t = (y - a[1]) / (b[1] - a[1]);
    (0.0..=1.0).contains(&t).then(|| a[0] + t * (b[0] - a[0]))
}

/// Largest x, in a row, of the points not further than `radius` from a segment; -inf if there are none.
fn rightmost(ends: [Point; 2], radius: f64, row: i32) -> f64 {
    let [a, b] = ends;
    let (low, high) = (f64::from(row), f64::from(row) + 1.0);
    // The right side is concave: its largest x is nearest to the height of the end further right.
    let y = (if a[0] > b[0] { a[1] } else { b[1] }).clamp(low, high);
    let disc = |centre: Point| {
        let rest = radius * radius - (y - centre[1]).powi(2);
        if rest >= 0.0 {
            centre[0] + rest.sqrt()
        } else {
            f64::NEG_INFINITY
        }
    };
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = (dx * dx + dy * dy).sqrt();
    let side = if length > 0.0 && dy != 0.0 {
        let offset = [dy.abs(), -dx * dy.signum()].map(|x| radius * x / length);
        let moved = |p: Point| [p[0] + offset[0], p[1] + offset[1]];
        crossing(moved(a), moved(b), y).unwrap_or(f64::NEG_INFINITY)
    } else {
        f64::NEG_INFINITY
    };
    disc(a).max(disc(b)).max(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Least distance of a point from a cell.
    fn distance(point: Point, column: i32, row: i32) -> f64 {
        let beyond = |x: f64, low: f64| (low - x).max(x - low - 1.0).max(0.0);
        beyond(point[0], column.into()).hypot(beyond(point[1], row.into()))
    }

    #[test]
    fn a_stroke_takes_the_cells_within_its_radius_and_no_other() {
        let ends = [[3.3, 2.1], [17.8, 9.4]];
        for ends in [
            ends,
            ends.map(|[x, y]| [y, x]),
            [[3.3, 9.4], [17.8, 2.1]],
            [[5.5, 5.5]; 2],
        ] {
            let radius = 1.7;
            let mut canvas = Canvas::new(30, 30, 4);
            canvas.stroke(ends, radius);
            let set = canvas.runs();
            for row in -4..26 {
                for column in -4..26 {
                    let nearest = (0..=4000)
                        .map(|k| {
                            let t = f64::from(k) / 4000.0;
                            let at = [0, 1].map(|i| ends[0][i] + t * (ends[1][i] - ends[0][i]));
                            distance(at, column, row)
                        })
                        .fold(f64::INFINITY, f64::min);
                    let taken = set
                        .iter()
                        .any(|run| run.row == row && (run.start..run.end).contains(&column));
                    if (nearest - radius).abs() > 0.01 {
                        assert_eq!(taken, nearest < radius, "({column}, {row}) at {nearest}");
                    }
                }
            }
        }
    }

    #[test]
    fn inner_blocks_are_full_wherever_the_low_corner_lies() {
        let mut canvas = Canvas::new(90, 40, 0);
        canvas.fill([[0.0, 0.0], [90.0, 3.0], [40.0, 40.0]]);
        let cells = canvas.runs();
        let full = |column: i32, row: i32| {
            cells
                .iter()
                .any(|run| run.row == row && (run.start..run.end).contains(&column))
        };
        let inner = canvas.inner();
        assert!(!inner.is_empty());
        let (size, before) = (BLOCK as i32, BLOCK as i32 - 1);
        for run in inner {
            for column in size * run.start - before..size * run.end {
                for row in size * run.row - before..size * (run.row + 1) {
                    assert!(full(column, row));
                }
            }
        }
    }
}
