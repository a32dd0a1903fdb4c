//! Overlapping pieces drawn apart in a shrinking square.
//!
//! The idea is that of sparrow (Gardeyn and Wauters 2025): let the pieces overlap in a square a
//! little too small, and draw them apart by a guided local search, in which pairs that stay entangled weigh
//! more and more; then shrink the square again. Overlap is measured here by distance fields: points on
//! the outline of one piece in the field of another tell how deep they lie and where to go, so that
//! all pieces move and turn at once, downhill. What counts in the end are exact distances.

use rayon::prelude::*;

use super::Gap;
use super::piece::Piece;
use super::shape::{Pose, Shape};
use crate::lbfgs::LimitedMemory;
use crate::random::Random;

type Point = [f64; 2];

/// Searches side by side.
const WALKERS: usize = 4;
/// After each of these rounds all searches aim below the smallest side.
const ROUNDS: usize = 12;
/// Points looked up by all walkers, about a second of one core.
const WORK: u64 = 100_000_000;
/// What a step costs beside the points that are looked up, for each piece in it.
const BASE: u64 = 200;
/// Part of `WORK` for the last, finest steps.
const POLISH: f64 = 0.15;
/// Distance of points on the outline, where the first layout has the extent 1.
const SPACING: f64 = 0.024;
/// Least distance added to the gap in the search, so that exact distances hold.
const MARGIN: f64 = 1.5e-4;
/// The largest and the least part of the side by which it shrinks.
const SHRINK: f64 = 0.02;
const LEAST_SHRINK: f64 = 1e-4;
/// Rounds of reweighting before the search starts from another layout.
const PATIENCE: usize = 15;
/// Random poses that are tried for a piece.
const TRIALS: usize = 40;

/// Poses of the pieces, the low corner of all and the side of the square that holds them.
#[derive(Debug, Clone)]
pub(super) struct Arrangement {
    pub(super) poses: Vec<Pose>,
    pub(super) extent: f64,
    pub(super) low: Point,
}

/// The pieces and what is to be kept.
pub(super) struct Task {
    pub(super) shapes: Vec<Shape>,
    /// Least distance between pieces.
    padding: Gap,
    /// Of the units of the pieces to those of poses.
    scale: f64,
    /// Distance added to the gap, for what the shapes leave out.
    slack: f64,
}

impl Task {
    /// `scale` is that of a layout whose extent is 1.
    pub(super) fn new(pieces: &[Piece], scale: f64, padding: Gap, slack: f64) -> Self {
        let reach = match padding {
            Gap::Share(share) => 1.1 * share / (1.0 - share),
            Gap::Length(length) => 1.1 * length * scale,
        } + 2.0 * MARGIN;
        let shapes = pieces
            .par_iter()
            .map(|piece| Shape::new(piece, scale, SPACING, reach))
            .collect();
        Self {
            shapes,
            padding,
            scale,
            slack,
        }
    }

    /// The square of the extents of poses.
    pub(super) fn arranged(&self, poses: &[Pose]) -> Arrangement {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for (shape, pose) in self.shapes.iter().zip(poses) {
            for &point in &shape.hull {
                let point = pose.apply(point);
                for k in 0..2 {
                    low[k] = low[k].min(point[k]);
                    high[k] = high[k].max(point[k]);
                }
            }
        }
        Arrangement {
            poses: poses.to_vec(),
            extent: (high[0] - low[0]).max(high[1] - low[1]),
            low,
        }
    }

    fn gap(&self, extent: f64) -> f64 {
        self.padding.at(self.scale, extent)
    }
}

/// A better layout than one that holds all pieces, if there is one.
pub(super) fn improve(task: &Task, first: &Arrangement) -> Option<Arrangement> {
    let mut walkers: Vec<Walker> = (0..WALKERS).map(|k| Walker::new(task, first, k)).collect();
    let mut best = first.clone();
    let budget = (WORK as f64 * (1.0 - POLISH)) as u64 / (WALKERS * ROUNDS) as u64;
    for round in 1..=ROUNDS as u64 {
        walkers
            .par_iter_mut()
            .for_each(|walker| walker.run(round * budget));
        for walker in &walkers {
            if walker.best.extent < best.extent {
                best = walker.best.clone();
            }
        }
        for walker in &mut walkers {
            walker.follow(best.extent);
        }
    }
    let mut last = Walker::new(task, &best, 0);
    last.shrink = 0.002;
    last.run((WORK as f64 * POLISH) as u64);
    if last.best.extent < best.extent {
        best = last.best;
    }
    (best.extent < first.extent).then_some(best)
}

struct Walker<'a> {
    task: &'a Task,
    poses: Vec<Pose>,
    best: Arrangement,
    /// Side of the square of the extents that is tried.
    side: f64,
    shrink: f64,
    /// Of each pair and, on the diagonal, of each piece and the border.
    weights: Vec<f64>,
    /// Distances that the fields call larger than they are.
    errors: Vec<f64>,
    numbers: Random,
    work: u64,
    tries: usize,
}

/// How far the points of one piece reach into another, and what drives them apart.
#[derive(Default, Clone, Copy)]
struct Push {
    energy: f64,
    deepest: f64,
    force: Point,
    torques: [f64; 2],
}

impl<'a> Walker<'a> {
    fn new(task: &'a Task, first: &Arrangement, index: usize) -> Self {
        let count = task.shapes.len();
        let mut walker = Self {
            task,
            poses: first.poses.clone(),
            best: first.clone(),
            side: first.extent,
            shrink: SHRINK,
            weights: vec![1.0; count * count],
            errors: vec![0.0; count * count],
            numbers: Random::new(0, index as u64),
            work: 0,
            tries: 0,
        };
        walker.poses = first
            .poses
            .iter()
            .map(|pose| Pose::new([0, 1].map(|k| pose.at[k] - first.low[k]), pose.angle))
            .collect();
        walker.best = Arrangement {
            poses: walker.poses.clone(),
            low: [0.0; 2],
            extent: first.extent,
        };
        if index > 0 {
            for piece in 0..count {
                walker.poses[piece] = walker.random_pose(piece);
            }
        }
        walker.aim(first.extent);
        walker
    }

    /// Shrinks the square below an extent.
    fn aim(&mut self, extent: f64) {
        let side = extent * (1.0 - self.shrink);
        let ratio = side / self.side;
        for pose in &mut self.poses {
            pose.at = pose.at.map(|x| x * ratio);
        }
        self.side = side;
        self.tries = 0;
        self.weights.fill(1.0);
    }

    /// Aims below the best of all.
    fn follow(&mut self, extent: f64) {
        if extent < self.side {
            self.aim(extent);
        }
    }

    fn run(&mut self, budget: u64) {
        while self.work < budget {
            self.descend(None);
            if self.settle() {
                continue;
            }
            self.tries += 1;
            if self.tries > PATIENCE {
                self.restart();
            } else {
                self.relocate();
            }
        }
    }

    /// Keeps the layout where it is legal and aims lower; else weighs what is entangled.
    fn settle(&mut self) -> bool {
        let count = self.poses.len();
        let tolerance = 0.5 * MARGIN;
        let mut energies = vec![0.0; count * count];
        let mut deepest = 0.0_f64;
        for i in 0..count {
            let push = self.border(i);
            energies[i * count + i] = push.energy;
            deepest = deepest.max(push.deepest);
            for j in 0..i {
                let push = self.pair(i, j);
                energies[i * count + j] = push.energy;
                deepest = deepest.max(push.deepest);
            }
        }
        if deepest <= tolerance {
            let found = self.task.arranged(&self.poses);
            let gap = self.task.gap(found.extent) + self.task.slack;
            let mut legal = true;
            for i in 0..count {
                for j in 0..i {
                    let [a, b] = [i, j].map(|k| &self.task.shapes[k]);
                    self.work += BASE;
                    if let Some(apart) = a.apart(&self.poses[i], b, &self.poses[j], gap) {
                        legal = false;
                        self.errors[i * count + j] += (gap - apart) + 0.1 * MARGIN;
                    }
                }
            }
            if legal {
                if found.extent < self.best.extent {
                    self.best = found;
                    self.shrink = (1.2 * self.shrink).min(SHRINK);
                }
                let extent = self.best.extent.min(self.side);
                self.aim(extent);
                return true;
            }
        }
        let most = energies.iter().copied().fold(1e-300, f64::max);
        for (weight, energy) in self.weights.iter_mut().zip(energies) {
            if energy > 0.0 {
                *weight *= 1.2 + 0.8 * energy / most;
            } else {
                *weight = (0.95 * *weight).max(1.0);
            }
        }
        false
    }

    /// Starts anew from the best layout with two pieces exchanged.
    fn restart(&mut self) {
        let count = self.poses.len();
        self.shrink *= 0.7;
        if self.shrink < LEAST_SHRINK {
            self.shrink = SHRINK;
            self.aim(self.best.extent);
            for piece in 0..count {
                self.poses[piece] = self.random_pose(piece);
            }
            return;
        }
        self.poses = self.best.poses.clone();
        for pose in &mut self.poses {
            pose.at = [0, 1].map(|k| pose.at[k] - self.best.low[k]);
        }
        self.side = self.best.extent;
        if self.numbers.below(2) == 0 {
            let (a, b) = (self.numbers.below(count), self.numbers.below(count));
            let (at, other) = (self.poses[a].at, self.poses[b].at);
            let angles = [a, b].map(|_| self.numbers.unit() * std::f64::consts::TAU);
            self.poses[a] = Pose::new(other, angles[0]);
            self.poses[b] = Pose::new(at, angles[1]);
        }
        self.aim(self.best.extent);
    }

    fn random_pose(&mut self, piece: usize) -> Pose {
        let reach = self.task.shapes[piece].radius * 0.5;
        let low = reach.min(0.5 * self.side);
        let at = [0, 1].map(|_| low + self.numbers.unit() * (self.side - 2.0 * low));
        Pose::new(at, self.numbers.unit() * std::f64::consts::TAU)
    }

    /// Weighted overlap of a piece at its pose.
    fn overlap(&mut self, piece: usize, bound: f64) -> f64 {
        let count = self.poses.len();
        let mut sum = self.weights[piece * count + piece] * self.border(piece).energy;
        for other in 0..count {
            if other != piece && sum < bound {
                let (i, j) = (piece.max(other), piece.min(other));
                sum += self.weights[i * count + j] * self.pair(i, j).energy;
            }
        }
        sum
    }

    /// Puts an entangled piece where it is less so.
    fn relocate(&mut self) {
        let count = self.poses.len();
        let overlaps: Vec<f64> = (0..count)
            .map(|piece| self.overlap(piece, f64::INFINITY))
            .collect();
        let mut left = self.numbers.unit() * overlaps.iter().sum::<f64>();
        let mut piece = count - 1;
        for (k, overlap) in overlaps.iter().enumerate() {
            left -= overlap;
            if left < 0.0 {
                piece = k;
                break;
            }
        }
        let before = self.poses[piece];
        let mut best = (f64::INFINITY, before);
        for _ in 0..TRIALS {
            self.poses[piece] = self.random_pose(piece);
            let overlap = self.overlap(piece, best.0);
            if overlap < best.0 {
                best = (overlap, self.poses[piece]);
            }
        }
        self.poses[piece] = best.1;
        let reached = self.descend(Some(piece));
        if reached >= overlaps[piece] {
            self.poses[piece] = before;
        }
    }

    fn pair(&mut self, i: usize, j: usize) -> Push {
        let task = self.task;
        let shapes = [i, j].map(|k| &task.shapes[k]);
        let poses = [i, j].map(|k| self.poses[k]);
        let gap = task.gap(self.side) + MARGIN + self.errors[i * self.poses.len() + j];
        let between = [0, 1].map(|k| poses[0].at[k] - poses[1].at[k]);
        if between[0].hypot(between[1]) > shapes[0].radius + shapes[1].radius + gap {
            self.work += 1;
            return Push::default();
        }
        self.work += (shapes[0].points.len() + shapes[1].points.len()) as u64;
        let first = push(shapes[0], &poses[0], shapes[1], &poses[1], gap);
        let second = push(shapes[1], &poses[1], shapes[0], &poses[0], gap);
        Push {
            energy: first.energy + second.energy,
            deepest: first.deepest.max(second.deepest),
            force: [0, 1].map(|k| first.force[k] - second.force[k]),
            torques: [0, 1].map(|k| first.torques[k] + second.torques[1 - k]),
        }
    }

    /// How far a piece reaches beyond the square.
    fn border(&mut self, piece: usize) -> Push {
        let shape = &self.task.shapes[piece];
        let pose = self.poses[piece];
        let mut sum = Push::default();
        self.work += BASE + shape.hull.len() as u64;
        for &point in &shape.hull {
            let placed = pose.apply(point);
            for k in 0..2 {
                let beyond = (placed[k] - self.side).max(0.0) + placed[k].min(0.0);
                if beyond != 0.0 {
                    sum.energy += beyond * beyond;
                    sum.deepest = sum.deepest.max(beyond.abs());
                    sum.force[k] += 2.0 * beyond;
                    let arm = [pose.at[1] - placed[1], placed[0] - pose.at[0]][k];
                    sum.torques[0] += 2.0 * beyond * arm;
                }
            }
        }
        sum
    }

    /// Weighted overlap of all pieces, or of one, and its gradient.
    fn value(&mut self, only: Option<usize>, gradient: &mut [f64]) -> f64 {
        let count = self.poses.len();
        let task = self.task;
        let radius = |piece: usize| task.shapes[piece].radius;
        let mut sum = 0.0;
        gradient.fill(0.0);
        for i in 0..count {
            if only.is_none_or(|piece| piece == i) {
                let weight = self.weights[i * count + i];
                let push = self.border(i);
                sum += weight * push.energy;
                let at = if only.is_some() { 0 } else { 3 * i };
                gradient[at] += weight * push.force[0];
                gradient[at + 1] += weight * push.force[1];
                gradient[at + 2] += weight * push.torques[0] / radius(i);
            }
            for j in 0..i {
                if only.is_none_or(|piece| piece == i || piece == j) {
                    let weight = self.weights[i * count + j];
                    let push = self.pair(i, j);
                    if push.energy == 0.0 {
                        continue;
                    }
                    sum += weight * push.energy;
                    for (k, sign, torque) in [(i, 1.0, push.torques[0]), (j, -1.0, push.torques[1])]
                    {
                        if only.is_none_or(|piece| piece == k) {
                            let at = if only.is_some() { 0 } else { 3 * k };
                            gradient[at] += sign * weight * push.force[0];
                            gradient[at + 1] += sign * weight * push.force[1];
                            gradient[at + 2] += weight * torque / radius(k);
                        }
                    }
                }
            }
        }
        sum
    }

    /// Moves all pieces, or one, downhill; returns the weighted overlap.
    fn descend(&mut self, only: Option<usize>) -> f64 {
        let moving: Vec<usize> = only.map_or_else(|| (0..self.poses.len()).collect(), |k| vec![k]);
        let n = 3 * moving.len();
        let Ok(mut memory) = LimitedMemory::new(n, 6) else {
            return f64::INFINITY;
        };
        let steps = if only.is_some() { 15 } else { 40 };
        let mut gradient = vec![0.0; n];
        let mut direction = vec![0.0; n];
        let mut value = self.value(only, &mut gradient);
        let mut next = vec![0.0; n];
        for _ in 0..steps {
            let square: f64 = gradient.iter().map(|g| g * g).sum();
            if value <= 1e-14 || square <= 1e-24 {
                break;
            }
            if memory.is_empty() {
                let factor = (0.25 * value / square).sqrt().min(value / square);
                let factor = factor.max(1e-12);
                for (d, g) in direction.iter_mut().zip(&gradient) {
                    *d = -factor * g;
                }
            } else if memory.direction(&gradient, &mut direction).is_err() {
                break;
            }
            let slope: f64 = direction.iter().zip(&gradient).map(|(d, g)| d * g).sum();
            if slope >= 0.0 {
                break;
            }
            let longest = direction.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
            let mut step = (0.05 / longest).min(1.0);
            let before: Vec<Pose> = moving.iter().map(|&k| self.poses[k]).collect();
            let mut accepted = false;
            for _ in 0..6 {
                for (m, (&piece, pose)) in moving.iter().zip(&before).enumerate() {
                    let d = &direction[3 * m..3 * m + 3];
                    let at = [0, 1].map(|k| pose.at[k] + step * d[k]);
                    let angle = pose.angle + step * d[2] / self.task.shapes[piece].radius;
                    self.poses[piece] = Pose::new(at, angle);
                }
                let reached = self.value(only, &mut next);
                if reached <= value + 1e-4 * step * slope {
                    let small = value - reached < 1e-3 * value;
                    let moved: Vec<f64> = direction.iter().map(|d| step * d).collect();
                    let change: Vec<f64> = next.iter().zip(&gradient).map(|(a, b)| a - b).collect();
                    let _ = memory.update(&moved, &change);
                    value = reached;
                    gradient.copy_from_slice(&next);
                    accepted = !small;
                    break;
                }
                step *= 0.4;
                for (&piece, &pose) in moving.iter().zip(&before) {
                    self.poses[piece] = pose;
                }
            }
            if !accepted {
                break;
            }
        }
        value
    }
}

/// Pushes the points of one piece out of another; the force is that on the first, in rising energy.
fn push(a: &Shape, pose: &Pose, b: &Shape, at: &Pose, gap: f64) -> Push {
    let mut sum = Push::default();
    let (cosine, sine) = (
        pose.cosine * at.cosine + pose.sine * at.sine,
        pose.sine * at.cosine - pose.cosine * at.sine,
    );
    let between = [pose.at[0] - at.at[0], pose.at[1] - at.at[1]];
    let shift = [
        at.cosine * between[0] + at.sine * between[1],
        at.cosine * between[1] - at.sine * between[0],
    ];
    let (mut force, mut own, mut other) = ([0.0; 2], 0.0, 0.0);
    for &point in &a.points {
        let arm = [
            cosine * point[0] - sine * point[1],
            sine * point[0] + cosine * point[1],
        ];
        let local = [arm[0] + shift[0], arm[1] + shift[1]];
        let Some((distance, slope)) = b.distance(local, gap) else {
            continue;
        };
        let depth = gap - distance;
        if depth > 0.0 {
            sum.energy += depth * depth;
            sum.deepest = sum.deepest.max(depth);
            let pull = slope.map(|x| -2.0 * depth * x);
            force[0] += pull[0];
            force[1] += pull[1];
            own += pull[1] * arm[0] - pull[0] * arm[1];
            other -= pull[1] * local[0] - pull[0] * local[1];
        }
    }
    sum.force = [
        at.cosine * force[0] - at.sine * force[1],
        at.sine * force[0] + at.cosine * force[1],
    ];
    sum.torques = [own, other];
    sum
}
