//! The search for a small square.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::hash::Hash;

use rayon::prelude::*;

use super::Gap;
use super::mask::Mask;
use super::piece::{Piece, turn};
use super::separate::{self, Task};
use super::shape::Pose;
use super::sheet::{Rule, Sheet, Spot};
use crate::error::{Error, Result};
use crate::random::Random;

/// Cells along the side of the square: finer is denser, at a cost that grows with the cube.
const CELLS: usize = 512;
/// Cells along the side for each piece along it: fewer leave no room for pieces of one cell.
const CELLS_PER_PIECE: f64 = 8.0;
/// Factor between two scales that are tried.
const COARSE_STEP: f64 = 0.85;
/// Halvings of the last step between two scales.
const HALVINGS: usize = 2;
/// Orders of the pieces that change side by side; each round takes the best of them.
const WALKERS: usize = 8;
/// Words that all walkers may read, about a second of one core.
const WORK: u64 = 50_000_000;
/// Part of the side that a plan which did well must do without next.
const STEP: usize = 100;
/// Most pieces whose order is searched for; more are placed once, by a quick rule.
const MOST_SEARCHED: usize = 400;
/// Quarter turns of many pieces that are tried.
const QUICK_TURNS: usize = 2;
/// Part of the square that many pieces and the gaps around them are thought to fill.
const FILL: f64 = 0.8;
/// Size classes of many pieces in an octave.
const CLASSES: f64 = 4.0;
/// Most pieces that are drawn apart.
const MOST_SEPARATED: usize = 64;
/// What the pieces to be drawn apart are rounded to, as a part of the largest: far more than
/// rounding makes of them, for that search takes another way at the least change.
const ROUNDING: f64 = 1.0 / (1 << 26) as f64;
/// Distance that rounding may take from a gap, where the extent is 1: each piece moves by at most
/// the step, which is at most 1.5 `ROUNDING`, and the gap grows with the extent.
const ROUNDING_SLACK: f64 = 6.0 * ROUNDING;
/// Steps in a whole turn, and in the extent, to which the first poses are rounded.
const POSE_STEPS: f64 = (1 << 28) as f64;
/// Angles between two quarter turns, and the most pieces for which so many are tried.
const ANGLES: [(usize, usize); 3] = [(32, 4), (128, 2), (usize::MAX, 1)];

/// Where a piece lies: which of its masks, and where the low corner of that is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    cosine: f64,
    sine: f64,
    shift: [f64; 2],
}

/// Places of all pieces and the square that holds them.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) places: Vec<Place>,
    scale: f64,
    side: f64,
    gap: f64,
}

impl Layout {
    /// A point of a piece in the unit square.
    pub(super) fn unit_square(&self, place: &Place, point: [f64; 2]) -> [f64; 2] {
        let turned = turn(point, place.cosine, place.sine);
        [0, 1].map(|k| {
            let cells = self.scale * turned[k] + place.shift[k];
            // Rounding alone leads out of the square.
            ((cells + 0.5 * self.gap) / (self.side + self.gap)).clamp(0.0, 1.0)
        })
    }
}

/// The densest layout found whose pieces are `padding` of the side apart.
pub(super) fn search(pieces: &[Piece], padding: Gap) -> Result<Layout> {
    let cells = CELLS.max((CELLS_PER_PIECE * (pieces.len() as f64).sqrt()).ceil() as usize);
    let padding = match padding {
        // One piece has no neighbour: a gap beyond its size would only cost memory.
        Gap::Length(length) if pieces.len() == 1 => Gap::Length(length.min(pieces[0].sides[0])),
        other => other,
    };
    let no_room = || Error::Parameter {
        argument: "padding",
        value: padding.value(),
        expected: "less: it leaves no room for the pieces",
    };
    let (scale, stock, first) = largest_scale(pieces, cells, padding).ok_or_else(no_room)?;
    let angles = ANGLES
        .into_iter()
        .find(|&(most, _)| pieces.len() <= most)
        .map_or(1, |(_, angles)| angles);
    let stock = if angles == 1 {
        stock
    } else {
        Stock::new(pieces, angles, scale, padding.at(scale, cells as f64))
    };
    let spots = improve(&stock, pieces, &first);
    let mut places = Vec::with_capacity(pieces.len());
    let mut extent = 0.0_f64;
    for (masks, (turn, spot)) in stock.masks.iter().zip(spots) {
        let mask = &masks[turn];
        let at = [spot.x as f64, spot.y as f64];
        extent = extent.max(mask.high[0] + at[0]).max(mask.high[1] + at[1]);
        places.push(Place {
            cosine: mask.cosine,
            sine: mask.sine,
            shift: [0, 1].map(|k| mask.shift[k] + at[k]),
        });
    }
    if pieces.len() <= MOST_SEPARATED
        && let Some(layout) = separated(pieces, &places, scale, extent, padding)
    {
        return Ok(layout);
    }
    Ok(Layout {
        places,
        scale,
        side: extent,
        gap: padding.at(scale, extent),
    })
}

/// A layout of some extent improved by drawing pieces apart in a smaller square.
fn separated(
    pieces: &[Piece],
    places: &[Place],
    scale: f64,
    extent: f64,
    padding: Gap,
) -> Option<Layout> {
    let step = ROUNDING * pieces.iter().map(Piece::reach).fold(0.0, f64::max);
    let rounded: Vec<Piece> = pieces.par_iter().map(|piece| piece.rounded(step)).collect();
    let unit = f64::from((scale * step / extent) as f32);
    let padding_of_task = match padding {
        // The units of the rounded pieces are steps.
        Gap::Length(length) => Gap::Length(length / step),
        share @ Gap::Share(_) => share,
    };
    let task = Task::new(&rounded, unit, padding_of_task, ROUNDING_SLACK);
    let poses: Vec<Pose> = task
        .shapes
        .iter()
        .zip(places)
        .map(|(shape, place)| {
            let centre = turn(shape.centre, place.cosine, place.sine);
            let at = [0, 1].map(|k| (scale * step * centre[k] + place.shift[k]) / extent);
            let turns = place.sine.atan2(place.cosine) / TAU;
            // Half a turn either way is one angle.
            let steps = (POSE_STEPS * turns).round().rem_euclid(POSE_STEPS);
            Pose::new(
                at.map(|x| (POSE_STEPS * x).round() / POSE_STEPS),
                TAU * (steps / POSE_STEPS),
            )
        })
        .collect();
    let found = separate::improve(&task, &task.arranged(&poses))?;
    let scale = unit / step;
    let mut places: Vec<Place> = task
        .shapes
        .iter()
        .zip(&found.poses)
        .map(|(shape, pose)| {
            let centre = turn(shape.centre, pose.cosine, pose.sine);
            Place {
                cosine: pose.cosine,
                sine: pose.sine,
                shift: [0, 1].map(|k| pose.at[k] - unit * centre[k]),
            }
        })
        .collect();
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (piece, place) in pieces.iter().zip(&places) {
        for &point in piece.hull() {
            let turned = turn(point, place.cosine, place.sine);
            for k in 0..2 {
                let x = scale * turned[k] + place.shift[k];
                low[k] = low[k].min(x);
                high[k] = high[k].max(x);
            }
        }
    }
    for place in &mut places {
        place.shift = [0, 1].map(|k| place.shift[k] - low[k]);
    }
    let side = (high[0] - low[0]).max(high[1] - low[1]);
    Some(Layout {
        places,
        scale,
        side,
        gap: padding.at(scale, side),
    })
}

/// The masks of all pieces at one scale.
struct Stock {
    masks: Vec<Vec<Mask>>,
    longest: usize,
    kinds: usize,
    /// Kinds are size classes, and a piece is placed above the last one of its kind.
    quick: bool,
}

/// Numbers masks by what is equal among those of one kind; returns the number of kinds.
fn number<K: Eq + Hash>(masks: &mut [Vec<Mask>], key: impl Fn(&Mask) -> K) -> usize {
    let mut kinds = HashMap::new();
    for mask in masks.iter_mut().flatten() {
        let next = kinds.len();
        mask.kind = *kinds.entry(key(mask)).or_insert(next);
    }
    kinds.len()
}

impl Stock {
    fn new(pieces: &[Piece], angles: usize, scale: f64, gap: f64) -> Self {
        let quick = pieces.len() > MOST_SEARCHED;
        let step = std::f64::consts::FRAC_PI_2 / angles as f64;
        let turns = if quick { QUICK_TURNS } else { 4 * angles };
        let mut masks: Vec<Vec<Mask>> = pieces
            .par_iter()
            .map(|piece| {
                (0..turns)
                    .map(|k| Mask::new(piece, piece.upright + k as f64 * step, scale, gap))
                    .collect()
            })
            .collect();
        let longest = masks.iter().flatten().map(|mask| mask.width).max();
        let longest = longest.unwrap_or(1);
        let kinds = if quick {
            let class = |cells: usize| (CLASSES * (cells as f64).log2()) as usize;
            number(&mut masks, |mask| (class(mask.width), class(mask.height)))
        } else {
            number(&mut masks, |mask| mask.touched.clone())
        };
        Self {
            masks,
            longest,
            kinds,
            quick,
        }
    }
}

/// The largest scale at which a bisection lets the pieces into the square, and their spots there.
fn largest_scale(pieces: &[Piece], cells: usize, padding: Gap) -> Option<(f64, Stock, Outcome)> {
    let plan = Plan {
        order: by_size(pieces),
        rule: Rule::Top,
        turns: vec![u32::MAX; pieces.len()],
    };
    let fitted = |scale: f64| {
        let stock = Stock::new(pieces, 1, scale, padding.at(scale, cells as f64));
        let outcome = plan.run(&stock, pieces, cells, 0.0);
        (outcome.left == 0.0).then_some((scale, stock, outcome))
    };
    let area: f64 = pieces.iter().map(|piece| piece.area).sum();
    let longest = pieces
        .iter()
        .map(|piece| piece.sides[0])
        .fold(0.0, f64::max);
    let mut high = cells as f64 * (1.0 / area.sqrt()).min(1.0 / longest);
    if let Gap::Length(length) = padding
        && pieces.len() > 1
    {
        // Two pieces so far apart reach over the whole square.
        high = high.min(cells as f64 / length);
    }
    let quick = pieces.len() > MOST_SEARCHED;
    if quick {
        // What fits is near the scale at which the pieces and their gaps fill most of the square.
        let mean: f64 = pieces
            .iter()
            .map(|piece| piece.sides[0] + piece.sides[1])
            .sum();
        let count = pieces.len() as f64;
        let filled = match padding {
            Gap::Share(_) => {
                let gap = padding.at(1.0, cells as f64);
                let half = 0.5 * gap * mean / area;
                let room = (FILL * (cells as f64).powi(2) - gap * gap * count) / area;
                (half * half + room.max(0.0)).sqrt() - half
            }
            Gap::Length(gap) => {
                cells as f64 * (FILL / (area + gap * mean + gap * gap * count)).sqrt()
            }
        };
        high = high.min(filled).max(0.6 / longest);
    }
    let mut best = fitted(high);
    while quick && best.is_some() {
        high /= COARSE_STEP;
        match fitted(high) {
            Some(better) => best = Some(better),
            None => break,
        }
    }
    while best.is_none() {
        // All pieces are single cells.
        if high * longest < 0.5 {
            return None;
        }
        let low = COARSE_STEP * high;
        best = fitted(low);
        if best.is_none() {
            high = low;
        }
    }
    for _ in 0..HALVINGS {
        let low = best.as_ref().map_or(high, |(scale, _, _)| *scale);
        let middle = 0.5 * (low + high);
        match fitted(middle) {
            Some(better) => best = Some(better),
            None => high = middle,
        }
    }
    best
}

/// Pieces by the size of their rectangles, the largest first.
fn by_size(pieces: &[Piece]) -> Vec<usize> {
    let size = |piece: &Piece| piece.sides[0] * piece.sides[1];
    let largest = pieces.iter().map(size).fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    // Single precision makes pieces of one size equal, whatever rounding made of them.
    order.sort_by_key(|&piece| {
        std::cmp::Reverse(((size(&pieces[piece]) / largest) as f32).to_bits())
    });
    order
}

/// How the pieces are placed, one after the other.
#[derive(Debug, Clone)]
struct Plan {
    order: Vec<usize>,
    rule: Rule,
    /// Bits of the masks of each piece that are tried.
    turns: Vec<u32>,
}

/// What became of a plan.
struct Outcome {
    /// Mask and spot of each piece, where there was one.
    spots: Vec<Option<(usize, Spot)>>,
    /// Area of the pieces that found none.
    left: f64,
    work: u64,
}

impl Outcome {
    /// Side of the square that holds the pieces, if all found a place.
    fn side(&self) -> Option<usize> {
        let mut sides = self.spots.iter().map(|spot| spot.map(|(_, spot)| spot.end));
        sides.try_fold(0, |side, end| Some(side.max(end?)))
    }
}

impl Plan {
    /// Places the pieces in a square; stops where more area than `spare` finds no place.
    fn run(&self, stock: &Stock, pieces: &[Piece], side: usize, spare: f64) -> Outcome {
        let mut sheet = Sheet::new(side, stock.longest, stock.kinds, stock.quick);
        let mut spots = vec![None; pieces.len()];
        let mut left = 0.0;
        for &piece in &self.order {
            let masks = &stock.masks[piece];
            let mut best: Option<(usize, Spot)> = None;
            for (turn, mask) in masks.iter().enumerate() {
                if self.turns[piece] >> turn & 1 == 1 {
                    let bound = best.map_or(f64::INFINITY, |(_, spot)| spot.rank);
                    if let Some(spot) = sheet.lowest(mask, self.rule, bound) {
                        best = Some((turn, spot));
                    }
                }
            }
            match best {
                Some((turn, spot)) => sheet.place(&masks[turn], spot),
                None => left += pieces[piece].area.max(f64::MIN_POSITIVE),
            }
            spots[piece] = best;
            if left > spare {
                break;
            }
        }
        Outcome {
            spots,
            left,
            work: sheet.work,
        }
    }

    /// A plan like this one, in which pieces that found no place come earlier.
    fn changed(&self, left: &[usize], turns: usize, numbers: &mut Random) -> Self {
        let mut plan = self.clone();
        let count = plan.order.len();
        for &piece in left {
            let Some(at) = plan.order.iter().position(|&other| other == piece) else {
                continue;
            };
            plan.order[numbers.below(at + 1)..=at].rotate_right(1);
        }
        for _ in 0..=numbers.below(3) {
            match numbers.below(8) {
                0 => plan.rule = Rule::ALL[numbers.below(Rule::ALL.len())],
                1 | 2 => {
                    let piece = numbers.below(count);
                    plan.turns[piece] = match numbers.below(2) {
                        0 => u32::MAX,
                        _ => 1 << numbers.below(turns),
                    };
                }
                _ => {
                    // Earlier pieces matter more.
                    let from = numbers.below(count);
                    let to = numbers.below(from + 1);
                    plan.order[to..=from].rotate_right(1);
                }
            }
        }
        plan
    }
}

/// One plan on its way, and how well it does in the present square.
struct Walker {
    plan: Plan,
    left: Vec<usize>,
    area: f64,
    numbers: Random,
}

/// Mask and spot of each piece in the smallest square found, from one that holds all in quarter
/// turns.
fn improve(stock: &Stock, pieces: &[Piece], first: &Outcome) -> Vec<(usize, Spot)> {
    let turns = stock.masks[0].len();
    let placed = |outcome: &Outcome, angles: usize| -> Vec<(usize, Spot)> {
        let spots = outcome.spots.iter().flatten();
        spots.map(|&(turn, spot)| (angles * turn, spot)).collect()
    };
    let mut best = placed(first, turns.div_ceil(4));
    let Some(mut side) = first.side() else {
        return best;
    };
    if pieces.len() > MOST_SEARCHED {
        return best;
    }
    let order = by_size(pieces);
    let mut walkers: Vec<Walker> = (0..WALKERS)
        .map(|k| Walker {
            plan: Plan {
                order: order.clone(),
                rule: Rule::ALL[k % Rule::ALL.len()],
                turns: vec![u32::MAX; pieces.len()],
            },
            left: Vec::new(),
            area: f64::INFINITY,
            numbers: Random::new(0, k as u64),
        })
        .collect();
    let mut work = 0;
    // What a round costs is known from the one before it.
    let mut cost = first.work * (WALKERS * turns / 4) as u64;
    while work + cost < WORK {
        let tried: Vec<(Plan, Outcome)> = walkers
            .par_iter_mut()
            .map(|walker| {
                let plan = if work == 0 {
                    walker.plan.clone()
                } else {
                    walker
                        .plan
                        .changed(&walker.left, turns, &mut walker.numbers)
                };
                let mut outcome = plan.run(stock, pieces, side - 1, walker.area);
                // The same order may do in a smaller square.
                while let Some(reached) = outcome.side() {
                    let smaller = reached - 1 - reached / STEP;
                    let next = plan.run(stock, pieces, smaller, 0.0);
                    let work = outcome.work + next.work;
                    if next.left > 0.0 {
                        outcome.work = work;
                        break;
                    }
                    outcome = Outcome { work, ..next };
                }
                (plan, outcome)
            })
            .collect();
        cost = tried.iter().map(|(_, outcome)| outcome.work).sum();
        work += cost;
        let before = side;
        for (walker, (plan, outcome)) in walkers.iter_mut().zip(tried) {
            if let Some(reached) = outcome.side().filter(|&reached| reached < side) {
                side = reached;
                best = placed(&outcome, 1);
            }
            if outcome.left <= walker.area {
                let missing = |&piece: &usize| outcome.spots[piece].is_none();
                walker.left = (0..pieces.len()).filter(missing).collect();
                walker.area = outcome.left;
                walker.plan = plan;
            }
        }
        if side < before {
            for walker in &mut walkers {
                walker.area = f64::INFINITY;
            }
        }
    }
    best
}
