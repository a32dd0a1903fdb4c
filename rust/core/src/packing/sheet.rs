//! The grid that pieces are placed on.

use std::ops::Range;

use super::mask::{BLOCK, Mask, Run, runs, set};

/// Decides between equals only: sides are of some thousand cells.
const TIE: f64 = 1e-4;

/// What counts as low.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// The upper side, then the right one.
    Top,
    /// The farther of the upper and the right side.
    Square,
    /// The height of the centre.
    Centre,
    /// The centre along the diagonal.
    Diagonal,
}

impl Rule {
    pub(super) const ALL: [Self; 4] = [Self::Top, Self::Square, Self::Centre, Self::Diagonal];

    /// Grows with x and with y.
    fn rank(self, mask: &Mask, x: usize, y: usize) -> f64 {
        let (left, low) = (x as f64, y as f64);
        let (right, top) = (left + mask.width as f64, low + mask.height as f64);
        match self {
            Self::Top => top + TIE * right,
            Self::Square => top.max(right) + TIE * (top + right),
            Self::Centre => low + mask.centre[1] + TIE * (left + mask.centre[0]),
            Self::Diagonal => low + mask.centre[1] + left + mask.centre[0],
        }
    }
}

/// A place for a mask and how low it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) rank: f64,
    /// Side of the square that reaches to its end.
    pub(super) end: usize,
}

/// A square of cells that a further piece must not touch, and of blocks with such a cell.
#[derive(Debug)]
pub(super) struct Sheet {
    side: usize,
    cells: Grid,
    blocks: Grid,
    /// The longest run of free cells in each row.
    gaps: Vec<i32>,
    /// Bands below which masks of each kind fit nowhere: what is taken stays so.
    floors: Vec<usize>,
    /// Whether a floor rises to where the last mask of its kind came to lie.
    quick: bool,
    /// Words read so far: the cost of the search.
    pub(super) work: u64,
}

impl Sheet {
    /// An empty square for masks of some kinds, none wider than `longest`.
    pub(super) fn new(side: usize, longest: usize, kinds: usize, quick: bool) -> Self {
        let cells = Grid::new(side, longest);
        Self {
            side,
            // To empty the square is work too: a bound even where nothing fits.
            work: (cells.levels.len() * cells.levels[0].len()) as u64,
            cells,
            blocks: Grid::new(side.div_ceil(BLOCK), longest.div_ceil(BLOCK)),
            gaps: vec![side as i32; side],
            floors: vec![0; kinds],
            quick,
        }
    }

    /// The lowest place below `bound` where a mask fits into the square.
    pub(super) fn lowest(&mut self, mask: &Mask, rule: Rule, mut bound: f64) -> Option<Spot> {
        let columns = (self.side + 1).checked_sub(mask.width)?;
        let rows = (self.side + 1).checked_sub(mask.height)?;
        let mut best = None;
        let mut taken_blocks = vec![0; columns.div_ceil(64 * BLOCK)];
        let mut fits = false;
        'bands: for band in self.floors[mask.kind]..rows.div_ceil(BLOCK) {
            if !fits {
                self.floors[mask.kind] = band;
            }
            if rule.rank(mask, 0, BLOCK * band) >= bound {
                break;
            }
            for (index, word) in taken_blocks.iter_mut().enumerate() {
                *word = close(columns.div_ceil(BLOCK) - 64 * index);
                *word = self
                    .blocks
                    .taken(&mask.inner, band, index, *word, &mut self.work);
            }
            if taken_blocks.iter().all(|&word| word == u64::MAX) {
                continue;
            }
            for y in BLOCK * band..rows.min(BLOCK * (band + 1)) {
                if rule.rank(mask, 0, y) >= bound {
                    break 'bands;
                }
                let too_long = |run: &Run| run.end - run.start > self.gaps[y + run.row as usize];
                if mask.touched.iter().any(too_long) {
                    continue;
                }
                for index in 0..columns.div_ceil(64) {
                    let blocks = taken_blocks[index / BLOCK] >> (16 * (index % BLOCK));
                    let beyond = close(columns - 64 * index);
                    let taken = spread(blocks) | beyond;
                    let taken = self
                        .cells
                        .taken(&mask.touched, y, index, taken, &mut self.work);
                    if taken != u64::MAX {
                        fits = true;
                        let x = 64 * index + taken.trailing_ones() as usize;
                        let rank = rule.rank(mask, x, y);
                        if rank < bound {
                            bound = rank;
                            let end = (x + mask.width).max(y + mask.height);
                            best = Some(Spot { x, y, rank, end });
                        }
                        break;
                    }
                }
            }
        }
        best
    }

    /// Takes the cells near a mask that lies at a spot.
    pub(super) fn place(&mut self, mask: &Mask, spot: Spot) {
        if self.quick {
            let floor = &mut self.floors[mask.kind];
            *floor = (*floor).max(spot.y / BLOCK);
        }
        let last = self.side as i64 - 1;
        let clamped = |cell: i32, by: usize| (i64::from(cell) + by as i64).clamp(0, last) as usize;
        for run in &mask.near {
            let row = i64::from(run.row) + spot.y as i64;
            let (start, end) = (run.start, run.end - 1);
            let outside =
                i64::from(end) + (spot.x as i64) < 0 || i64::from(start) + spot.x as i64 > last;
            if (0..=last).contains(&row) && !outside {
                let row = row as usize;
                let (start, end) = (clamped(start, spot.x), clamped(end, spot.x));
                self.cells.set(row, start, end + 1);
                self.blocks.set(row / BLOCK, start / BLOCK, end / BLOCK + 1);
            }
        }
        let rows = |size: usize| {
            let first = mask.near.first().map_or(0, |run| clamped(run.row, spot.y));
            let last = mask.near.last().map_or(0, |run| clamped(run.row, spot.y));
            first / size..=last / size
        };
        for row in rows(1) {
            self.cells.lift(row);
            self.gaps[row] = self.cells.longest_gap(row, self.side);
        }
        rows(BLOCK).for_each(|row| self.blocks.lift(row));
    }
}

/// Rows of bits.
#[derive(Debug)]
struct Grid {
    words: usize,
    /// `levels[k]` marks the cells from which one of the next 2^k is taken.
    levels: Vec<Vec<u64>>,
}

impl Grid {
    fn new(side: usize, longest: usize) -> Self {
        let words = side.div_ceil(64);
        let count = longest.max(1).ilog2() as usize + 1;
        // Columns beyond the side are read, though nothing depends on them: one row more.
        Self {
            words,
            levels: vec![vec![0; words * (side + 1) + 1]; count],
        }
    }

    fn row(&self, row: usize) -> Range<usize> {
        row * self.words..(row + 1) * self.words
    }

    fn set(&mut self, row: usize, start: usize, end: usize) {
        let row = self.row(row);
        set(&mut self.levels[0][row], start, end);
    }

    /// Brings the higher levels of a row up to date.
    fn lift(&mut self, row: usize) {
        let cells = self.row(row);
        for level in 1..self.levels.len() {
            let (lower, upper) = self.levels.split_at_mut(level);
            let lower = &lower[level - 1][cells.clone()];
            let upper = &mut upper[0][cells.clone()];
            upper.copy_from_slice(lower);
            shift_or(upper, lower, 1 << (level - 1));
        }
    }

    /// Length of the longest run of free cells in a row.
    fn longest_gap(&self, row: usize, side: usize) -> i32 {
        let (mut longest, mut at) = (0, 0);
        for (start, end) in runs(&self.levels[0][self.row(row)]) {
            longest = longest.max(start - at);
            at = end;
        }
        longest.max(side - at) as i32
    }

    /// Marks which of 64 columns meet what is taken when runs are moved up to a row, until all do.
    fn taken(&self, runs: &[Run], y: usize, word: usize, mut taken: u64, work: &mut u64) -> u64 {
        for run in runs {
            if taken == u64::MAX {
                break;
            }
            let level = (run.end - run.start).ilog2() as usize;
            let cells = &self.levels[level][(y + run.row as usize) * self.words + word..];
            taken |= moved(cells, run.start as usize);
            taken |= moved(cells, run.end as usize - (1 << level));
            *work += 1;
        }
        taken
    }
}

/// The 64 bits from a place on.
fn moved(words: &[u64], place: usize) -> u64 {
    let (index, place) = (place / 64, (place % 64) as u32);
    words[index] >> place | (words[index + 1] << 1) << (63 - place)
}

/// A word whose bits from a number on are set.
fn close(open: usize) -> u64 {
    u64::MAX.checked_shl(open as u32).unwrap_or(0)
}

/// Each of the lowest 16 bits four times.
fn spread(bits: u64) -> u64 {
    let mut bits = bits & 0xffff;
    bits = (bits | bits << 24) & 0x0000_00ff_0000_00ff;
    bits = (bits | bits << 12) & 0x000f_000f_000f_000f;
    bits = (bits | bits << 6) & 0x0303_0303_0303_0303;
    bits = (bits | bits << 3) & 0x1111_1111_1111_1111;
    0xf * bits
}

/// Adds bits moved down by a number of places.
fn shift_or(to: &mut [u64], from: &[u64], places: usize) {
    let (skip, places) = (places / 64, (places % 64) as u32);
    let from = from.get(skip..).unwrap_or(&[]);
    for (to, pair) in to.iter_mut().zip(from.windows(2)) {
        *to |= pair[0] >> places | (pair[1] << 1) << (63 - places);
    }
    // The last word has none after it.
    if let Some((to, from)) = to.get_mut(from.len().wrapping_sub(1)).zip(from.last()) {
        *to |= from >> places;
    }
}
