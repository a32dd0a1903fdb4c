//! Pieces of the plane side by side in a square, by a search on a raster.
//!
//! A piece covers all cells that it touches. One after the other, the large ones first, the pieces
//! go where the square around all of them grows least, each in the best of its four quarter turns;
//! cells nearer than the gap to a piece are closed to the others. The best of several orders wins.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use rayon::prelude::*;

use crate::error::{Error, Result};

/// Longest side of a piece in cells: what a raster of a gigabyte holds.
const LONGEST_SIDE: f64 = 65536.0;
const WORD: usize = u64::BITS as usize;
/// Every so many trials all turns of each piece are tried, at four times the cost.
const FREE: usize = 4;
/// Trials that take the pieces strictly by size; in the others it is blurred.
const ORDERED: usize = 16;

/// Where the pieces lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Placement {
    /// Low corner of the bounding rectangle of each turned piece, in cells.
    pub low: Vec<[usize; 2]>,
    /// Counterclockwise quarter turns of each piece, 0 to 3.
    pub turns: Vec<u8>,
    /// Side of the square around all pieces, in whole cells.
    pub side: usize,
}

/// Lays pieces side by side, at least `gap` apart.
///
/// `pieces` holds the triangles of each piece, three corners after each other, in cells and with
/// the low corner of its bounding rectangle at the origin. The placement is the smallest of `trials`
/// that differ in the order of the pieces, and the same for any number of threads.
///
/// # Errors
/// [`Error::Topology`] for a piece without corners, with one that is negative or not finite, or
/// with a side of more than 65536 cells; [`Error::Parameter`] for a `gap` that is no length of at
/// most as many cells.
pub fn pack(pieces: &[&[[f64; 2]]], gap: f64, trials: usize) -> Result<Placement> {
    if !(0.0..=LONGEST_SIDE).contains(&gap) {
        return Err(Error::Parameter {
            argument: "gap",
            value: gap,
            expected: "in 0..65536",
        });
    }
    for (index, piece) in pieces.iter().enumerate() {
        let inside = |x: &f64| (0.0..=LONGEST_SIDE).contains(x);
        if piece.is_empty() || !piece.as_flattened().iter().all(inside) {
            return Err(Error::Topology {
                argument: "pieces",
                reason: format!("piece {index} must have corners in 0..65536"),
            });
        }
    }
    let shapes: Vec<[Shape; 4]> = pieces
        .par_iter()
        .map(|piece| std::array::from_fn(|turns| Shape::new(piece, turns, gap)))
        .collect();
    // The side to beat. A trial that is larger could not win, whichever trial ended first.
    let least = AtomicUsize::new(usize::MAX);
    let placements: Vec<Placement> = (0..trials.max(1))
        .into_par_iter()
        .filter_map(|trial| place(&shapes, gap, trial, &least))
        .collect();
    let best = placements
        .into_iter()
        .min_by_key(|placement| placement.side);
    Ok(best.unwrap_or(Placement {
        low: Vec::new(),
        turns: Vec::new(),
        side: 0,
    }))
}

/// Rows of bits, from the low row up.
#[derive(Clone)]
struct Bitmap {
    width: usize,
    height: usize,
    words: usize,
    bits: Vec<u64>,
}

impl Bitmap {
    fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(WORD);
        Self {
            width,
            height,
            words,
            bits: vec![0; words * height],
        }
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.bits[y * self.words..(y + 1) * self.words]
    }

    fn row_mut(&mut self, y: usize) -> &mut [u64] {
        &mut self.bits[y * self.words..(y + 1) * self.words]
    }

    fn fill(&mut self, y: usize, from: usize, to: usize) {
        for (k, word) in self.row_mut(y).iter_mut().enumerate() {
            let (low, high) = (from.max(k * WORD), to.min((k + 1) * WORD));
            if low < high {
                *word |= (u64::MAX >> (WORD - (high - low))) << (low - k * WORD);
            }
        }
    }
}

/// Adds a row of bits, moved up by `shift` bits, to another one that has room for it.
fn add_shifted(target: &mut [u64], row: &[u64], shift: usize) {
    let (first, low) = (shift / WORD, shift % WORD);
    for (k, &word) in row.iter().enumerate().filter(|(_, word)| **word != 0) {
        target[first + k] |= word << low;
        if low > 0 && word >> (WORD - low) != 0 {
            target[first + k + 1] |= word >> (WORD - low);
        }
    }
}

/// A piece in one of its turns.
struct Shape {
    cells: Bitmap,
    /// The cells that it closes to others; its low corner is `margin` cells below that of `cells`.
    closed: Bitmap,
    /// First cell of the lowest row.
    anchor: usize,
}

impl Shape {
    fn new(piece: &[[f64; 2]], turns: usize, gap: f64) -> Self {
        let cells = cover(&turned(piece, turns));
        let closed = close(&cells, gap);
        let row = cells.row(0);
        let word = row.iter().position(|&word| word != 0).unwrap_or(0);
        let anchor = word * WORD + row[word].trailing_zeros() as usize;
        Self {
            cells,
            closed,
            anchor,
        }
    }
}

fn turned(piece: &[[f64; 2]], turns: usize) -> Vec<[f64; 2]> {
    let high = piece
        .iter()
        .fold([0.0_f64; 2], |h, p| [h[0].max(p[0]), h[1].max(p[1])]);
    piece
        .iter()
        .map(|&[x, y]| match turns {
            0 => [x, y],
            1 => [high[1] - y, x],
            2 => [high[0] - x, high[1] - y],
            _ => [y, high[0] - x],
        })
        .collect()
}

/// All cells that triangles touch with more than their border.
fn cover(corners: &[[f64; 2]]) -> Bitmap {
    let extent = |axis: usize| corners.iter().fold(0.0_f64, |e, p| e.max(p[axis]));
    let size = [0, 1].map(|axis| (extent(axis).ceil() as usize).max(1));
    let mut cells = Bitmap::new(size[0], size[1]);
    // The cells from `low` to `high`, at least one.
    let range = |low: f64, high: f64, size: usize| {
        let first = (low as usize).min(size - 1);
        (first, (high.ceil() as usize).clamp(first + 1, size))
    };
    for triangle in corners.chunks_exact(3) {
        let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
        let low = a[1].min(b[1]).min(c[1]);
        let high = a[1].max(b[1]).max(c[1]);
        let (first, last) = range(low, high, size[1]);
        for y in first..last {
            let band = [y as f64, (y + 1) as f64];
            let mut span = [f64::INFINITY, f64::NEG_INFINITY];
            let mut reach = |x: f64| span = [span[0].min(x), span[1].max(x)];
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if (band[0]..=band[1]).contains(&p[1]) {
                    reach(p[0]);
                }
                for line in band {
                    if (p[1] < line) != (q[1] < line) {
                        let t = (line - p[1]) / (q[1] - p[1]);
                        reach(p[0] + t * (q[0] - p[0]));
                    }
                }
            }
            if span[0] <= span[1] {
                let (from, to) = range(span[0], span[1], size[0]);
                cells.fill(y, from, to);
            }
        }
    }
    cells
}

/// The cells with a point nearer than `gap` to one of `cells`, and these.
fn close(cells: &Bitmap, gap: f64) -> Bitmap {
    let margin = margin(gap);
    let mut closed = Bitmap::new(cells.width + 2 * margin, cells.height + 2 * margin);
    let apart = |offset: usize| offset.saturating_sub(1) as f64;
    // How far to the sides, for each number of rows up or down.
    let sides: Vec<usize> = (0..=margin)
        .map(|up| {
            (0..=margin)
                .rev()
                .find(|&side| apart(side).hypot(apart(up)) < gap)
                .unwrap_or(0)
        })
        .collect();
    let mut wide = vec![0; closed.words];
    for y in 0..cells.height {
        wide.fill(0);
        for side in 0..=margin {
            add_shifted(&mut wide, cells.row(y), margin + side);
            add_shifted(&mut wide, cells.row(y), margin - side);
            for up in (0..=margin).filter(|&up| sides[up] == side) {
                add_shifted(closed.row_mut(y + margin + up), &wide, 0);
                add_shifted(closed.row_mut(y + margin - up), &wide, 0);
            }
        }
    }
    closed
}

/// Cells around a piece that it may close to others.
fn margin(gap: f64) -> usize {
    gap.ceil() as usize
}

/// An order of the pieces from large to small, by a measure of size that depends on the trial.
fn order(shapes: &[[Shape; 4]], trial: usize) -> Vec<usize> {
    let size = |k: usize| {
        let [w, h] = [shapes[k][0].cells.width, shapes[k][0].cells.height].map(|n| n as f64);
        match trial {
            0..ORDERED => w + h,
            // From half the size to the whole.
            _ => (w + h) * (1.0 + noise(trial, k)),
        }
    };
    let mut order: Vec<usize> = (0..shapes.len()).collect();
    order.sort_by(|&i, &j| size(j).total_cmp(&size(i)));
    order
}

/// A number in [0, 1) from a fixed stream (SplitMix64; Steele, Lea and Flood 2014).
fn noise(trial: usize, k: usize) -> f64 {
    let mut z = ((trial as u64) << 32 | k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// The turns of a piece that a trial has to choose from.
///
/// The best turn of each piece alone may be a bad one for all: most trials try one, the first two
/// the same for all pieces.
fn choices(trial: usize, k: usize) -> std::ops::Range<usize> {
    let turn = match trial {
        0 | 1 => trial,
        _ if trial.is_multiple_of(FREE) => return 0..4,
        _ => (4.0 * noise(trial, k + (1 << 31))) as usize,
    };
    turn..turn + 1
}

/// The placement of one trial, or none where it gets larger than `least`, which it lowers.
fn place(shapes: &[[Shape; 4]], gap: f64, trial: usize, least: &AtomicUsize) -> Option<Placement> {
    let mut sheet = Sheet::new(margin(gap));
    let mut low = vec![[0; 2]; shapes.len()];
    let mut turns = vec![0; shapes.len()];
    for k in order(shapes, trial) {
        let mut best: Option<(u8, Spot)> = None;
        for turn in choices(trial, k) {
            let shape = &shapes[k][turn];
            sheet.make_room(shape);
            let bound = best.as_ref().map_or(u64::MAX, |(_, spot)| spot.cost);
            if let Some(spot) = sheet.best_spot(shape, bound) {
                best = Some((turn as u8, spot));
            }
        }
        let (turn, spot) = best?;
        sheet.put(&shapes[k][turn as usize], spot.low);
        (low[k], turns[k]) = (spot.low, turn);
        if sheet.side() > least.load(Relaxed) {
            return None;
        }
    }
    let side = sheet.side();
    least.fetch_min(side, Relaxed);
    Some(Placement { low, turns, side })
}

/// A free place and the size of the sheet that it would make.
struct Spot {
    low: [usize; 2],
    cost: u64,
}

/// The closed cells, `margin` more of them on the low sides, and the extents of the pieces.
struct Sheet {
    closed: Bitmap,
    margin: usize,
    width: usize,
    height: usize,
}

impl Sheet {
    fn new(margin: usize) -> Self {
        Self {
            closed: Bitmap::new(WORD, 1),
            margin,
            width: 0,
            height: 0,
        }
    }

    fn side(&self) -> usize {
        self.width.max(self.height)
    }

    /// Makes the sheet large enough for a shape beyond all others in both directions.
    fn make_room(&mut self, shape: &Shape) {
        // One word more than the shape may reach into.
        let width = self.width + self.margin + shape.closed.width + 2 * WORD;
        let height = self.height + self.margin + shape.closed.height;
        if width <= self.closed.width && height <= self.closed.height {
            return;
        }
        let mut larger = Bitmap::new(width.max(self.closed.width), height.max(self.closed.height));
        for y in 0..self.closed.height {
            larger.row_mut(y)[..self.closed.words].copy_from_slice(self.closed.row(y));
        }
        self.closed = larger;
    }

    /// The lowest, then leftmost, of the free places of least cost, if that is below `bound`.
    fn best_spot(&self, shape: &Shape, bound: u64) -> Option<Spot> {
        let cost = |x: usize, y: usize| {
            let width = self.width.max(x + shape.cells.width) as u64;
            let height = self.height.max(y + shape.cells.height) as u64;
            // The square counts, and of equal squares the smaller rectangle.
            width.max(height).pow(2) + width * height
        };
        let mut best: Option<Spot> = None;
        let mut bound = bound;
        // What hits at one place hits at the next one, as a rule.
        let mut row = 0;
        for y in 0..=self.height + self.margin {
            if cost(0, y) >= bound {
                break;
            }
            let mut x = 0;
            while let Some(free) = self.next_free(x, y, shape) {
                x = free;
                if x > self.width + self.margin || cost(x, y) >= bound {
                    break;
                }
                let Some(hit) = self.hit(shape, x, y, row) else {
                    bound = cost(x, y);
                    let low = [x, y];
                    best = Some(Spot { low, cost: bound });
                    break;
                };
                row = hit;
                x += 1;
            }
        }
        best
    }

    /// The first column from `x` on where the first cell of the shape is free.
    fn next_free(&self, x: usize, y: usize, shape: &Shape) -> Option<usize> {
        let offset = shape.anchor + self.margin;
        let row = self.closed.row(y + self.margin);
        let start = x + offset;
        let mut word = start / WORD;
        let mut free = !*row.get(word)? & (u64::MAX << (start % WORD));
        while free == 0 {
            word += 1;
            free = !*row.get(word)?;
        }
        Some(word * WORD + free.trailing_zeros() as usize - offset)
    }

    /// The row of the shape that hits a closed cell, if any does; `first` is looked at first.
    fn hit(&self, shape: &Shape, x: usize, y: usize, first: usize) -> Option<usize> {
        let (word, shift) = ((x + self.margin) / WORD, (x + self.margin) % WORD);
        std::iter::once(first)
            .chain(0..shape.cells.height)
            .find(|&j| {
                let closed = &self.closed.row(y + self.margin + j)[word..];
                shape.cells.row(j).iter().enumerate().any(|(k, &cells)| {
                    closed[k] & (cells << shift) != 0
                        || (shift > 0 && closed[k + 1] & (cells >> (WORD - shift)) != 0)
                })
            })
    }

    fn put(&mut self, shape: &Shape, low: [usize; 2]) {
        for j in 0..shape.closed.height {
            add_shifted(self.closed.row_mut(low[1] + j), shape.closed.row(j), low[0]);
        }
        self.width = self.width.max(low[0] + shape.cells.width);
        self.height = self.height.max(low[1] + shape.cells.height);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(width: f64, height: f64) -> Vec<[f64; 2]> {
        let [a, b, c, d] = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        vec![a, b, c, a, c, d]
    }

    fn packed(pieces: &[Vec<[f64; 2]>], gap: f64) -> Placement {
        let pieces: Vec<&[[f64; 2]]> = pieces.iter().map(Vec::as_slice).collect();
        pack(&pieces, gap, 6).unwrap()
    }

    #[test]
    fn squares_fill_a_square() {
        let placement = packed(&vec![rectangle(10.0, 10.0); 9], 0.0);
        assert_eq!(placement.side, 30);
        let placement = packed(&vec![rectangle(10.0, 10.0); 9], 3.0);
        assert_eq!(placement.side, 36);
    }

    #[test]
    fn long_pieces_are_turned() {
        let placement = packed(&[rectangle(40.0, 20.0), rectangle(20.0, 40.0)], 0.0);
        assert_eq!(placement.side, 40);
        assert_eq!((placement.turns[0] + placement.turns[1]) % 2, 1);
    }

    #[test]
    fn small_pieces_go_into_holes() {
        // A frame of four bars around a hole of 20 cells.
        let mut frame = Vec::new();
        for (x, y, w, h) in [
            (0.0, 0.0, 40.0, 10.0),
            (0.0, 30.0, 40.0, 10.0),
            (0.0, 0.0, 10.0, 40.0),
            (30.0, 0.0, 10.0, 40.0),
        ] {
            frame.extend(rectangle(w, h).iter().map(|p| [p[0] + x, p[1] + y]));
        }
        let placement = packed(&[frame, rectangle(16.0, 16.0)], 2.0);
        assert_eq!(placement.side, 40);
        assert_eq!(placement.low[1], [12, 12]);
    }

    #[test]
    fn cells_closer_than_the_gap_are_closed() {
        let mut cell = Bitmap::new(1, 1);
        cell.fill(0, 0, 1);
        for gap in [0.0, 0.5, 1.0, 1.5, 2.5, 7.3] {
            let closed = close(&cell, gap);
            let reach = margin(gap) as i64;
            for y in -reach..=reach {
                for x in -reach..=reach {
                    let apart = |d: i64| (d.abs() - 1).max(0) as f64;
                    let near = (x, y) == (0, 0) || apart(x).hypot(apart(y)) < gap;
                    let (u, v) = ((x + reach) as usize, (y + reach) as usize);
                    let bit = closed.row(v)[u / WORD] >> (u % WORD) & 1 == 1;
                    assert_eq!(bit, near, "gap {gap}, offset {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn every_touched_cell_is_covered() {
        let triangle = [[0.5, 0.0], [7.0, 2.5], [0.0, 6.1]];
        let cells = cover(&triangle);
        assert_eq!((cells.width, cells.height), (7, 7));
        // Points of the triangle on a fine grid of barycentric coordinates.
        for i in 0..=200 {
            for j in 0..=200 - i {
                let [a, b] = [i, j].map(|k| f64::from(k) / 200.0);
                let point = |axis: usize| {
                    a * triangle[0][axis]
                        + b * triangle[1][axis]
                        + (1.0 - a - b) * triangle[2][axis]
                };
                let x = (point(0) as usize).min(6);
                let y = (point(1) as usize).min(6);
                assert!(cells.row(y)[0] >> x & 1 == 1, "{x} {y}");
            }
        }
        // The upper right corner is far from it.
        assert!(cells.row(6)[0] >> 6 & 1 == 0);
    }

    #[test]
    fn pieces_without_extent_have_a_place() {
        let placement = packed(&[vec![[0.0, 0.0]; 3], vec![[0.0, 0.0]; 3]], 1.0);
        assert_ne!(placement.low[0], placement.low[1]);
    }

    #[test]
    fn bad_pieces_are_refused() {
        assert!(pack(&[&[[0.0, f64::NAN]]], 1.0, 1).is_err());
        assert!(pack(&[&[[0.0, -1.0]]], 1.0, 1).is_err());
        assert!(pack(&[&[]], 1.0, 1).is_err());
        assert!(pack(&[], -1.0, 1).is_err());
    }
}
