//! Whole units of a surface, faces or polygons, shared out among the leaves of a binary tree.
//!
//! Each node of the tree splits its units in two connected parts. Shares as even as whole units
//! allow come first, then short seams, then agreement with the segments that were found on finer
//! triangles. Few units are tried in every way; more of them are moved across the seam one by one,
//! with all that hangs on them, until no move and no pair of moves helps.

use std::collections::HashMap;

/// Shares that are met to this part count as met, so that seams are free to be short.
const MET: f64 = 0.002;
/// Up to so many units every way to split them is tried.
const EXHAUSTIVE: usize = 14;
/// Pairs of moves are tried on seams of up to so many units.
const PAIRED: usize = 64;
/// Passes over the units at a seam; a few dozen are enough.
const PASSES: usize = 400;
/// What counts as better, relative to what there is: sums in another order round differently.
const BETTER: f64 = 1e-9;

/// Units and what their common borders cost as seams, in compressed rows.
#[derive(Debug, Clone, Copy)]
pub struct Units<'a> {
    /// Where the neighbours of each unit start, and one more.
    pub starts: &'a [i64],
    /// Neighbours of each unit.
    pub neighbours: &'a [i64],
    /// Cost of a seam between a unit and each neighbour.
    pub costs: &'a [f64],
    /// Area of each unit.
    pub areas: &'a [f64],
}

/// Areas of the units that the leaves cover, in compressed rows.
#[derive(Debug, Clone, Copy)]
pub struct Coverage<'a> {
    /// Where the entries of each unit start, and one more.
    pub starts: &'a [i64],
    /// Leaf of each entry.
    pub leaves: &'a [i64],
    /// Covered area of each entry.
    pub areas: &'a [f64],
}

impl Units<'_> {
    fn around(&self, u: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let row = self.starts[u] as usize..self.starts[u + 1] as usize;
        row.map(|k| (self.neighbours[k] as usize, self.costs[k]))
    }
}

impl Coverage<'_> {
    /// Area of a unit that the leaves of a run cover.
    fn of(&self, u: usize, run: Run) -> f64 {
        (self.starts[u] as usize..self.starts[u + 1] as usize)
            .filter(|&k| (run.start..run.end).contains(&(self.leaves[k] as usize)))
            .map(|k| self.areas[k])
            .sum()
    }
}

/// A run of leaves: those of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Run {
    start: usize,
    end: usize,
}

impl Run {
    fn len(self) -> usize {
        self.end - self.start
    }
}

/// How good a split is, what counts most first; less is better.
#[derive(Debug, Clone, Copy, Default)]
struct Merit {
    missing: f64,
    uneven: f64,
    seam: f64,
    strange: f64,
}

impl Merit {
    fn plus(self, other: Self) -> Self {
        Self {
            missing: self.missing + other.missing,
            uneven: self.uneven + other.uneven,
            seam: self.seam + other.seam,
            strange: self.strange + other.strange,
        }
    }

    fn better_than(self, other: Self) -> bool {
        let pairs = [
            (self.missing, other.missing),
            (self.uneven, other.uneven),
            (self.seam, other.seam),
            (self.strange, other.strange),
        ];
        for (mine, theirs) in pairs {
            let margin = BETTER * (mine.abs() + theirs.abs());
            if (mine - theirs).abs() > margin {
                return mine < theirs;
            }
        }
        false
    }
}

/// Square of the part of a share by which an area misses it.
fn missed(area: f64, share: f64) -> f64 {
    let off = ((area / share - 1.0).abs() - MET).max(0.0);
    off * off
}

/// Leaf of every unit.
///
/// The units connect. `shares` are the areas that the leaves are to have, and `splits` the runs of
/// leaves that the nodes of the tree cut: first leaf, first leaf of the second child, and one past
/// the last leaf, parents before children. There are at least as many units as leaves. Every node
/// gets connected units, and at least as many as it has leaves.
#[must_use]
pub fn share_out(
    units: &Units<'_>,
    coverage: &Coverage<'_>,
    shares: &[f64],
    splits: &[[usize; 3]],
) -> Vec<u32> {
    let n = units.areas.len();
    let middles: HashMap<Run, usize> = splits
        .iter()
        .map(|&[start, middle, end]| (Run { start, end }, middle))
        .collect();
    let mut leaf = vec![0; n];
    let mut work = vec![(
        (0..n).collect::<Vec<_>>(),
        Run {
            start: 0,
            end: shares.len(),
        },
    )];
    let mut search = Search::new(units, n);
    while let Some((members, run)) = work.pop() {
        let Some(&middle) = middles.get(&run) else {
            for &u in &members {
                leaf[u] = run.start as u32;
            }
            continue;
        };
        if members.len() <= EXHAUSTIVE {
            let mut all = Exhaustive::new(units, coverage, shares, &middles, &members);
            all.assign((1 << members.len()) - 1, run, &mut leaf);
            continue;
        }
        let first = Run {
            start: run.start,
            end: middle,
        };
        let second = Run {
            start: middle,
            end: run.end,
        };
        let scores: Vec<f64> = members
            .iter()
            .map(|&u| coverage.of(u, first) - coverage.of(u, second))
            .collect();
        let sum = |run: Run| shares[run.start..run.end].iter().sum::<f64>();
        let share = sum(first) / (sum(first) + sum(second));
        search.split(&members, &scores, share, [first.len(), second.len()]);
        let (positive, negative) = members.iter().partition(|&&u| search.side[u] == FIRST);
        for &u in &members {
            search.side[u] = OUTSIDE;
        }
        work.push((positive, first));
        work.push((negative, second));
    }
    fill_leaves(units, shares.len(), &mut leaf);
    leaf
}

/// Gives each leaf without a unit one of those of the leaf with most, which stay connected.
fn fill_leaves(units: &Units<'_>, n_leaves: usize, leaf: &mut [u32]) {
    let mut members = vec![Vec::new(); n_leaves];
    for (u, &l) in leaf.iter().enumerate() {
        members[l as usize].push(u);
    }
    for empty in 0..n_leaves {
        if !members[empty].is_empty() {
            continue;
        }
        let largest = (0..n_leaves).fold(0, |best, l| {
            if members[l].len() > members[best].len() {
                l
            } else {
                best
            }
        });
        if members[largest].len() < 2 {
            return;
        }
        // The last unit of a search: without it the others connect.
        let mut reached = vec![members[largest][0]];
        let mut next = 0;
        while next < reached.len() {
            for (v, _) in units.around(reached[next]) {
                if leaf[v] as usize == largest && !reached.contains(&v) {
                    reached.push(v);
                }
            }
            next += 1;
        }
        let last = reached[reached.len() - 1];
        leaf[last] = empty as u32;
        members[largest].retain(|&u| u != last);
        members[empty].push(last);
    }
}

/// All ways to share few units out, by their sets of bits.
struct Exhaustive<'a> {
    members: &'a [usize],
    middles: &'a HashMap<Run, usize>,
    shares: &'a [f64],
    around: Vec<u32>,
    costs: Vec<Vec<f64>>,
    areas: Vec<f64>,
    covered: Vec<Vec<f64>>,
    connected: HashMap<u32, bool>,
    best: HashMap<(u32, Run), (Merit, u32)>,
}

impl<'a> Exhaustive<'a> {
    fn new(
        units: &Units<'_>,
        coverage: &Coverage<'_>,
        shares: &'a [f64],
        middles: &'a HashMap<Run, usize>,
        members: &'a [usize],
    ) -> Self {
        let place: HashMap<usize, usize> =
            members.iter().enumerate().map(|(k, &u)| (u, k)).collect();
        let n = members.len();
        let mut around = vec![0; n];
        let mut costs = vec![vec![0.0; n]; n];
        for (k, &u) in members.iter().enumerate() {
            for (v, cost) in units.around(u) {
                if let Some(&other) = place.get(&v) {
                    around[k] |= 1 << other;
                    costs[k][other] += cost;
                }
            }
        }
        Self {
            members,
            middles,
            shares,
            around,
            costs,
            areas: members.iter().map(|&u| units.areas[u]).collect(),
            covered: members
                .iter()
                .map(|&u| {
                    let mut row = vec![0.0; shares.len()];
                    for k in coverage.starts[u] as usize..coverage.starts[u + 1] as usize {
                        row[coverage.leaves[k] as usize] += coverage.areas[k];
                    }
                    row
                })
                .collect(),
            connected: HashMap::new(),
            best: HashMap::new(),
        }
    }

    fn connects(&mut self, set: u32) -> bool {
        if let Some(&known) = self.connected.get(&set) {
            return known;
        }
        let mut seen = set & set.wrapping_neg();
        let mut fresh = seen;
        while fresh != 0 {
            let k = fresh.trailing_zeros() as usize;
            fresh &= fresh - 1;
            let found = self.around[k] & set & !seen;
            seen |= found;
            fresh |= found;
        }
        self.connected.insert(set, seen == set);
        seen == set
    }

    fn seam(&self, first: u32, second: u32) -> f64 {
        bits(first)
            .map(|k| {
                bits(second & self.around[k])
                    .map(|other| self.costs[k][other])
                    .sum::<f64>()
            })
            .sum()
    }

    /// The least merit of a set for a run, and its part for the first child.
    fn solve(&mut self, set: u32, run: Run) -> (Merit, u32) {
        if set == 0 {
            let merit = Merit {
                missing: run.len() as f64,
                ..Merit::default()
            };
            return (merit, set);
        }
        let Some(&middle) = self.middles.get(&run) else {
            let area = bits(set).map(|k| self.areas[k]).sum();
            let covered: f64 = bits(set).map(|k| self.covered[k][run.start]).sum();
            let merit = Merit {
                uneven: missed(area, self.shares[run.start]),
                strange: -covered,
                ..Merit::default()
            };
            return (merit, set);
        };
        if let Some(&known) = self.best.get(&(set, run)) {
            return known;
        }
        let first_run = Run {
            start: run.start,
            end: middle,
        };
        let second_run = Run {
            start: middle,
            end: run.end,
        };
        let mut best: Option<(Merit, u32)> = None;
        // A star of four units has no two connected halves of two: then leaves are left without.
        for enough in [true, false] {
            let mut first = set;
            loop {
                let second = set & !first;
                let short = (first.count_ones() as usize) < first_run.len()
                    || (second.count_ones() as usize) < second_run.len();
                if !(enough && short) && self.connects(first) && self.connects(second) {
                    let here = Merit {
                        seam: self.seam(first, second),
                        ..Merit::default()
                    };
                    let merit = here
                        .plus(self.solve(first, first_run).0)
                        .plus(self.solve(second, second_run).0);
                    if best.is_none_or(|(least, _)| merit.better_than(least)) {
                        best = Some((merit, first));
                    }
                }
                if first == 0 {
                    break;
                }
                first = (first - 1) & set;
            }
            if best.is_some() {
                break;
            }
        }
        let found = best.unwrap_or_else(|| (Merit::default(), set));
        self.best.insert((set, run), found);
        found
    }

    fn assign(&mut self, set: u32, run: Run, leaf: &mut [u32]) {
        let Some(&middle) = self.middles.get(&run) else {
            for k in bits(set) {
                leaf[self.members[k]] = run.start as u32;
            }
            return;
        };
        if set == 0 {
            return;
        }
        let (_, first) = self.solve(set, run);
        self.assign(
            first,
            Run {
                start: run.start,
                end: middle,
            },
            leaf,
        );
        self.assign(
            set & !first,
            Run {
                start: middle,
                end: run.end,
            },
            leaf,
        );
    }
}

fn bits(set: u32) -> impl Iterator<Item = usize> {
    (0..u32::BITS as usize).filter(move |&k| set >> k & 1 == 1)
}

const OUTSIDE: u8 = 2;
const FIRST: u8 = 0;
const SECOND: u8 = 1;

/// Moves across the seam between two connected sides, and the buffers of their searches.
struct Search<'a> {
    units: &'a Units<'a>,
    side: Vec<u8>,
    /// Covered area of each member by the first child less that by the second.
    score: Vec<f64>,
    /// Round and seed by which a unit was reached.
    stamp: Vec<u32>,
    seed: Vec<u32>,
    round: u32,
}

/// Where the sides stand: area of the first, units of both, length of the seam.
#[derive(Debug, Clone, Copy)]
struct Standing {
    area: f64,
    counts: [usize; 2],
    seam: f64,
    strange: f64,
}

/// What the two sides of a node are to have.
struct Wanted {
    area: f64,
    total: f64,
    counts: [usize; 2],
}

impl Wanted {
    fn merit(&self, standing: Standing) -> Merit {
        let short = |side: usize| self.counts[side].saturating_sub(standing.counts[side]) as f64;
        Merit {
            missing: short(0) + short(1),
            uneven: missed(standing.area, self.area)
                + missed(self.total - standing.area, self.total - self.area),
            seam: standing.seam,
            strange: standing.strange,
        }
    }
}

impl<'a> Search<'a> {
    fn new(units: &'a Units<'a>, n: usize) -> Self {
        Self {
            units,
            side: vec![OUTSIDE; n],
            score: vec![0.0; n],
            stamp: vec![0; n],
            seed: vec![0; n],
            round: 0,
        }
    }

    /// Sets the sides of the members, which connect.
    fn split(&mut self, members: &[usize], scores: &[f64], share: f64, counts: [usize; 2]) {
        for (&u, &score) in members.iter().zip(scores) {
            self.side[u] = if score >= 0.0 { FIRST } else { SECOND };
            self.score[u] = score;
        }
        self.connect(members, SECOND);
        self.connect(members, FIRST);
        self.fill_empty(members);
        let total: f64 = members.iter().map(|&u| self.units.areas[u]).sum();
        let wanted = Wanted {
            area: share * total,
            total,
            counts,
        };
        let mut standing = self.standing(members);
        for _ in 0..PASSES {
            let seam = self.at_seam(members);
            let mut moved = false;
            for &u in &seam {
                moved |= self.try_move(u, &wanted, &mut standing);
            }
            if !moved && seam.len() <= PAIRED {
                moved = self.try_pairs(members, &seam, &wanted, &mut standing);
            }
            if !moved {
                break;
            }
        }
    }

    fn standing(&self, members: &[usize]) -> Standing {
        let mut standing = Standing {
            area: 0.0,
            counts: [0, 0],
            seam: 0.0,
            strange: 0.0,
        };
        for &u in members {
            let side = self.side[u];
            standing.counts[side as usize] += 1;
            if side == FIRST {
                standing.area += self.units.areas[u];
                standing.strange -= self.score[u];
            }
            for (v, cost) in self.units.around(u) {
                if v > u && self.side[v] != OUTSIDE && self.side[v] != side {
                    standing.seam += cost;
                }
            }
        }
        standing
    }

    /// Leaves one component to the other side than `kept`: the largest.
    fn connect(&mut self, members: &[usize], kept: u8) {
        let side = SECOND - kept;
        let mut largest: (f64, Vec<usize>) = (0.0, Vec::new());
        self.round += 1;
        for &u in members {
            if self.side[u] != side || self.stamp[u] == self.round {
                continue;
            }
            self.stamp[u] = self.round;
            let mut part = vec![u];
            let mut next = 0;
            while next < part.len() {
                for (v, _) in self.units.around(part[next]) {
                    if self.side[v] == side && self.stamp[v] != self.round {
                        self.stamp[v] = self.round;
                        part.push(v);
                    }
                }
                next += 1;
            }
            let area = part.iter().map(|&u| self.units.areas[u]).sum();
            if area > largest.0 || largest.1.is_empty() {
                largest = (area, part);
            }
        }
        for &u in members {
            if self.side[u] == side {
                self.side[u] = kept;
            }
        }
        for u in largest.1 {
            self.side[u] = side;
        }
    }

    /// Gives an empty side the last unit of a search, without which the others connect.
    fn fill_empty(&mut self, members: &[usize]) {
        let full = self.side[members[0]];
        if members.iter().any(|&u| self.side[u] != full) {
            return;
        }
        self.round += 1;
        let mut reached = vec![members[0]];
        self.stamp[members[0]] = self.round;
        let mut next = 0;
        while next < reached.len() {
            for (v, _) in self.units.around(reached[next]) {
                if self.side[v] == full && self.stamp[v] != self.round {
                    self.stamp[v] = self.round;
                    reached.push(v);
                }
            }
            next += 1;
        }
        self.side[reached[reached.len() - 1]] = SECOND - full;
    }

    /// Units beside the other side, those first whose move shortens the seam most.
    fn at_seam(&self, members: &[usize]) -> Vec<usize> {
        let mut found: Vec<(f64, usize)> = members
            .iter()
            .filter_map(|&u| {
                let (mut longer, mut beside) = (0.0, false);
                for (v, cost) in self.units.around(u) {
                    if self.side[v] == self.side[u] {
                        longer += cost;
                    } else if self.side[v] != OUTSIDE {
                        longer -= cost;
                        beside = true;
                    }
                }
                beside.then_some((longer, u))
            })
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().map(|(_, u)| u).collect()
    }

    /// A unit and what hangs on it: what its side would lose the connection to without it.
    ///
    /// None where the unit is its whole side, or no longer beside the other one.
    fn hanging(&mut self, u: usize) -> Option<Vec<usize>> {
        let side = self.side[u];
        let other = SECOND - side;
        if !self.units.around(u).any(|(v, _)| self.side[v] == other) {
            return None;
        }
        self.round += 1;
        self.stamp[u] = self.round;
        let mut queues: Vec<Vec<usize>> = Vec::new();
        for (v, _) in self.units.around(u) {
            if self.side[v] == side && self.stamp[v] != self.round {
                self.stamp[v] = self.round;
                self.seed[v] = queues.len() as u32;
                queues.push(vec![v]);
            }
        }
        if queues.is_empty() {
            return None;
        }
        let n = queues.len();
        let mut group: Vec<usize> = (0..n).collect();
        let mut next = vec![0; n];
        loop {
            let root = group[0];
            if group.iter().all(|&g| g == root) {
                return Some(vec![u]);
            }
            // All searches take a step in turn: what it costs is the size of what hangs.
            let mut growing: Vec<usize> = (0..n).filter(|&k| next[k] < queues[k].len()).collect();
            growing = growing.iter().map(|&k| group[k]).collect();
            growing.sort_unstable();
            growing.dedup();
            if growing.len() <= 1 {
                let rest = growing.first().copied().unwrap_or_else(|| {
                    let size = |g: usize| -> usize {
                        (0..n)
                            .filter(|&k| group[k] == g)
                            .map(|k| queues[k].len())
                            .sum()
                    };
                    group
                        .iter()
                        .copied()
                        .max_by_key(|&g| (size(g), g))
                        .unwrap_or(0)
                });
                let mut set = vec![u];
                for k in (0..n).filter(|&k| group[k] != rest) {
                    set.extend(&queues[k]);
                }
                return Some(set);
            }
            for k in 0..n {
                let Some(&here) = queues[k].get(next[k]) else {
                    continue;
                };
                next[k] += 1;
                for (v, _) in self.units.around(here) {
                    if self.side[v] != side {
                        continue;
                    }
                    if self.stamp[v] != self.round {
                        self.stamp[v] = self.round;
                        self.seed[v] = k as u32;
                        queues[k].push(v);
                    } else if v != u {
                        let (mine, theirs) = (group[k], group[self.seed[v] as usize]);
                        if mine != theirs {
                            group
                                .iter_mut()
                                .filter(|g| **g == theirs)
                                .for_each(|g| *g = mine);
                        }
                    }
                }
            }
        }
    }

    /// Turns a set over and returns where the sides stand then.
    fn turn(&mut self, set: &[usize], mut standing: Standing) -> Standing {
        for &u in set {
            let side = self.side[u];
            let sign = if side == FIRST { -1.0 } else { 1.0 };
            standing.area += sign * self.units.areas[u];
            standing.strange -= sign * self.score[u];
            standing.counts[side as usize] -= 1;
            standing.counts[(SECOND - side) as usize] += 1;
            for (v, cost) in self.units.around(u) {
                if self.side[v] == side {
                    standing.seam += cost;
                } else if self.side[v] != OUTSIDE {
                    standing.seam -= cost;
                }
            }
            self.side[u] = SECOND - side;
        }
        standing
    }

    fn try_move(&mut self, u: usize, wanted: &Wanted, standing: &mut Standing) -> bool {
        let Some(set) = self.hanging(u) else {
            return false;
        };
        let then = self.turn(&set, *standing);
        if wanted.merit(then).better_than(wanted.merit(*standing)) {
            *standing = then;
            return true;
        }
        self.turn(&set, then);
        false
    }

    /// A move and then another one, which together help.
    fn try_pairs(
        &mut self,
        members: &[usize],
        seam: &[usize],
        wanted: &Wanted,
        standing: &mut Standing,
    ) -> bool {
        for &u in seam {
            let Some(set) = self.hanging(u) else {
                continue;
            };
            let between = self.turn(&set, *standing);
            for v in self.at_seam(members) {
                let Some(second) = self.hanging(v) else {
                    continue;
                };
                let then = self.turn(&second, between);
                if wanted.merit(then).better_than(wanted.merit(*standing)) {
                    *standing = then;
                    return true;
                }
                self.turn(&second, then);
            }
            self.turn(&set, between);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// A connected graph with random areas, costs and covered areas, in rows.
    struct Case {
        links: Vec<Vec<(usize, f64)>>,
        areas: Vec<f64>,
        covered: Vec<Vec<f64>>,
        shares: Vec<f64>,
        splits: Vec<[usize; 3]>,
    }

    impl Case {
        fn random(seed: u64, n: usize, n_leaves: usize, even: bool) -> Self {
            let mut random = Random::new(seed, 0);
            let mut links = vec![Vec::new(); n];
            let mut link = |a: usize, b: usize, cost: f64| {
                if a != b && links[a].iter().all(|&(other, _)| other != b) {
                    links[a].push((b, cost));
                    links[b].push((a, cost));
                }
            };
            for u in 1..n {
                link(u, random.below(u), random.unit() + 0.1);
            }
            for _ in 0..n {
                link(random.below(n), random.below(n), random.unit() + 0.1);
            }
            let areas: Vec<f64> = (0..n)
                .map(|_| if even { 1.0 } else { random.unit() + 0.2 })
                .collect();
            let covered = areas
                .iter()
                .map(|area| {
                    let parts: Vec<f64> = (0..n_leaves).map(|_| random.unit()).collect();
                    let sum: f64 = parts.iter().sum();
                    parts.iter().map(|part| area * part / sum).collect()
                })
                .collect();
            let total: f64 = areas.iter().sum();
            let shares = vec![total / n_leaves as f64; n_leaves];
            let mut splits = Vec::new();
            let mut runs = vec![(0, n_leaves)];
            while let Some((start, end)) = runs.pop() {
                if end - start > 1 {
                    let middle = start + (end - start).div_ceil(2);
                    splits.push([start, middle, end]);
                    runs.extend([(start, middle), (middle, end)]);
                }
            }
            Self {
                links,
                areas,
                covered,
                shares,
                splits,
            }
        }

        fn shared_out(&self) -> Vec<u32> {
            let (mut starts, mut neighbours, mut costs) = (vec![0], Vec::new(), Vec::new());
            for row in &self.links {
                neighbours.extend(row.iter().map(|&(v, _)| v as i64));
                costs.extend(row.iter().map(|&(_, cost)| cost));
                starts.push(neighbours.len() as i64);
            }
            let n_leaves = self.shares.len();
            let rows = self.areas.len();
            let units = Units {
                starts: &starts,
                neighbours: &neighbours,
                costs: &costs,
                areas: &self.areas,
            };
            let coverage = Coverage {
                starts: &(0..=rows)
                    .map(|u| (u * n_leaves) as i64)
                    .collect::<Vec<_>>(),
                leaves: &(0..rows * n_leaves)
                    .map(|k| (k % n_leaves) as i64)
                    .collect::<Vec<_>>(),
                areas: &self.covered.concat(),
            };
            share_out(&units, &coverage, &self.shares, &self.splits)
        }

        /// Whether the units of these leaves hang together.
        fn connects(&self, leaf: &[u32], leaves: std::ops::Range<usize>) -> bool {
            let inside = |u: usize| leaves.contains(&(leaf[u] as usize));
            let members: Vec<usize> = (0..leaf.len()).filter(|&u| inside(u)).collect();
            let mut reached = members[..members.len().min(1)].to_vec();
            let mut next = 0;
            while next < reached.len() {
                for &(v, _) in &self.links[reached[next]] {
                    if inside(v) && !reached.contains(&v) {
                        reached.push(v);
                    }
                }
                next += 1;
            }
            reached.len() == members.len()
        }

        /// Whether every node connects and every leaf has a unit.
        fn is_legal(&self, leaf: &[u32]) -> bool {
            (0..self.shares.len())
                .all(|l| leaf.contains(&(l as u32)) && self.connects(leaf, l..l + 1))
                && self
                    .splits
                    .iter()
                    .all(|&[start, _, end]| self.connects(leaf, start..end))
        }

        fn merit(&self, leaf: &[u32]) -> Merit {
            let mut merit = Merit::default();
            let mut areas = vec![0.0; self.shares.len()];
            for (u, &l) in leaf.iter().enumerate() {
                areas[l as usize] += self.areas[u];
                merit.strange -= self.covered[u][l as usize];
                for &(v, cost) in &self.links[u] {
                    if v < u && leaf[v] != l {
                        merit.seam += cost;
                    }
                }
            }
            for (area, share) in areas.iter().zip(&self.shares) {
                merit.uneven += missed(*area, *share);
            }
            merit
        }
    }

    /// The best of all ways to give the units to the leaves, or none where no way is legal.
    fn by_brute_force(case: &Case) -> Option<Merit> {
        let (n, n_leaves) = (case.areas.len(), case.shares.len());
        let mut best: Option<Merit> = None;
        for number in 0..n_leaves.pow(n as u32) {
            let leaf: Vec<u32> = (0..n)
                .map(|u| (number / n_leaves.pow(u as u32) % n_leaves) as u32)
                .collect();
            if case.is_legal(&leaf) {
                let merit = case.merit(&leaf);
                if best.is_none_or(|least| merit.better_than(least)) {
                    best = Some(merit);
                }
            }
        }
        best
    }

    #[test]
    fn few_units_are_shared_out_in_the_best_way_of_all() {
        let mut legal = 0;
        for seed in 0..60 {
            let n_leaves = 2 + seed as usize % 3;
            let n = n_leaves + seed as usize % 5;
            let case = Case::random(seed, n, n_leaves, seed % 2 == 0);
            let leaf = case.shared_out();
            let Some(best) = by_brute_force(&case) else {
                continue;
            };
            legal += 1;
            assert!(case.is_legal(&leaf), "seed {seed}: {leaf:?}");
            let found = case.merit(&leaf);
            assert!(
                !best.better_than(found),
                "seed {seed}: {found:?} instead of {best:?}"
            );
        }
        assert!(legal > 30);
    }

    #[test]
    fn many_units_stay_connected_and_no_move_of_one_helps() {
        for seed in 0..20 {
            let case = Case::random(seed, 20 + 3 * seed as usize, 2, false);
            let leaf = case.shared_out();
            assert!(case.is_legal(&leaf), "seed {seed}");
            let found = case.merit(&leaf);
            for u in 0..leaf.len() {
                let mut moved = leaf.clone();
                moved[u] = 1 - moved[u];
                if case.is_legal(&moved) {
                    assert!(
                        !case.merit(&moved).better_than(found),
                        "seed {seed}, unit {u}"
                    );
                }
            }
        }
    }

    #[test]
    fn many_leaves_are_connected_and_full() {
        for seed in 0..20 {
            let n_leaves = 3 + seed as usize % 6;
            let case = Case::random(seed, 12 * n_leaves, n_leaves, true);
            let leaf = case.shared_out();
            for l in 0..n_leaves {
                assert!(leaf.contains(&(l as u32)), "seed {seed}, leaf {l}");
                assert!(case.connects(&leaf, l..l + 1), "seed {seed}, leaf {l}");
            }
        }
    }
}
