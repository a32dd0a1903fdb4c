//! Minimum cuts: augmenting paths from two search trees (Boykov and Kolmogorov 2004).

use std::collections::VecDeque;

/// No arc, no node.
const NONE: u32 = u32::MAX;
/// Parent of a node that hangs on its terminal.
const TERMINAL: u32 = u32::MAX - 1;

/// The side of a cut that a node is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Source,
    Sink,
}

/// A network of nodes, each with an arc from the source or to the sink, and undirected edges.
#[derive(Debug, Clone)]
pub(super) struct Network {
    /// Capacity left from the source, or, negative, to the sink.
    terminals: Vec<f64>,
    /// First arc out of each node.
    first: Vec<u32>,
    /// Arcs in pairs of opposite ones: arc `a` and its sister `a ^ 1`.
    heads: Vec<u32>,
    following: Vec<u32>,
    residuals: Vec<f64>,
    flow: f64,
}

/// The search trees.
struct Trees {
    /// Arc from each node to its parent.
    parents: Vec<u32>,
    sides: Vec<Option<Side>>,
    /// When the distance was found to lead to the terminal, and the distance.
    times: Vec<u32>,
    distances: Vec<u32>,
    active: VecDeque<u32>,
    queued: Vec<bool>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl Network {
    pub fn new(n: usize) -> Self {
        Self {
            terminals: vec![0.0; n],
            first: vec![NONE; n],
            heads: Vec::new(),
            following: Vec::new(),
            residuals: Vec::new(),
            flow: 0.0,
        }
    }

    /// Adds what it costs to put node `i` on the side of the source and of the sink.
    pub fn add_costs(&mut self, i: usize, source: f64, sink: f64) {
        let before = self.terminals[i];
        let after = before + sink - source;
        // What both sides cost flows at once.
        self.flow += source + (-before).max(0.0) - (-after).max(0.0);
        self.terminals[i] = after;
    }

    /// Adds an edge that costs its capacity where it is cut.
    pub fn add_edge(&mut self, i: usize, j: usize, capacity: f64) {
        for (from, to) in [(i, j), (j, i)] {
            self.heads.push(to as u32);
            self.following.push(self.first[from]);
            self.residuals.push(capacity);
            self.first[from] = self.heads.len() as u32 - 1;
        }
    }

    fn arcs(&self, i: u32) -> impl Iterator<Item = u32> {
        let start = self.first[i as usize];
        std::iter::successors((start != NONE).then_some(start), |&a| {
            let next = self.following[a as usize];
            (next != NONE).then_some(next)
        })
    }

    /// The least cost of a cut, and the side of each node; the source has as few as possible.
    pub fn minimum_cut(mut self) -> (f64, Vec<Side>) {
        let n = self.first.len();
        let mut trees = Trees {
            parents: vec![NONE; n],
            sides: vec![None; n],
            times: vec![0; n],
            distances: vec![0; n],
            active: VecDeque::new(),
            queued: vec![false; n],
            orphans: VecDeque::new(),
            time: 0,
        };
        for i in 0..n {
            if self.terminals[i] != 0.0 {
                trees.sides[i] = Some(if self.terminals[i] > 0.0 {
                    Side::Source
                } else {
                    Side::Sink
                });
                trees.parents[i] = TERMINAL;
                trees.distances[i] = 1;
                trees.activate(i as u32);
            }
        }
        while let Some(i) = trees.next_active() {
            while let Some(bridge) = self.grow(&mut trees, i) {
                trees.time += 1;
                self.augment(&mut trees, bridge);
                self.adopt(&mut trees);
                if trees.sides[i as usize].is_none() {
                    break;
                }
            }
        }
        let sides = trees
            .sides
            .iter()
            .map(|&side| {
                if side == Some(Side::Source) {
                    Side::Source
                } else {
                    Side::Sink
                }
            })
            .collect();
        (self.flow, sides)
    }

    /// Capacity of arc `a` away from the root of the tree of `side`.
    fn outward(&self, a: u32, side: Side) -> f64 {
        match side {
            Side::Source => self.residuals[a as usize],
            Side::Sink => self.residuals[a as usize ^ 1],
        }
    }

    /// Grows the tree at node `i`; the arc from the tree of the source to that of the sink where
    /// they meet.
    fn grow(&self, trees: &mut Trees, i: u32) -> Option<u32> {
        let side = trees.sides[i as usize]?;
        for a in self.arcs(i) {
            if self.outward(a, side) <= 0.0 {
                continue;
            }
            let j = self.heads[a as usize] as usize;
            match trees.sides[j] {
                None => {
                    trees.sides[j] = Some(side);
                    trees.parents[j] = a ^ 1;
                    trees.times[j] = trees.times[i as usize];
                    trees.distances[j] = trees.distances[i as usize] + 1;
                    trees.activate(j as u32);
                }
                Some(other) if other != side => {
                    return Some(if side == Side::Source { a } else { a ^ 1 });
                }
                Some(_) => {
                    if trees.times[j] <= trees.times[i as usize]
                        && trees.distances[j] > trees.distances[i as usize] + 1
                    {
                        // A shorter way to the terminal.
                        trees.parents[j] = a ^ 1;
                        trees.times[j] = trees.times[i as usize];
                        trees.distances[j] = trees.distances[i as usize] + 1;
                    }
                }
            }
        }
        None
    }

    /// Sends what fits along the path through the bridge.
    fn augment(&mut self, trees: &mut Trees, bridge: u32) {
        let start = self.heads[bridge as usize ^ 1];
        let end = self.heads[bridge as usize];
        let mut amount = self.residuals[bridge as usize];
        for (node, side) in [(start, Side::Source), (end, Side::Sink)] {
            let mut i = node;
            while trees.parents[i as usize] != TERMINAL {
                let up = trees.parents[i as usize];
                amount = amount.min(self.outward(up ^ 1, side));
                i = self.heads[up as usize];
            }
            amount = amount.min(self.terminals[i as usize].abs());
        }
        self.residuals[bridge as usize] -= amount;
        self.residuals[bridge as usize ^ 1] += amount;
        for (node, side) in [(start, Side::Source), (end, Side::Sink)] {
            let mut i = node;
            loop {
                let up = trees.parents[i as usize];
                if up == TERMINAL {
                    let terminal = &mut self.terminals[i as usize];
                    *terminal -= amount.copysign(*terminal);
                    if *terminal == 0.0 {
                        trees.orphan(i);
                    }
                    break;
                }
                // Along the path the flow runs from the source to the sink.
                let along = if side == Side::Source { up ^ 1 } else { up };
                self.residuals[along as usize] -= amount;
                self.residuals[along as usize ^ 1] += amount;
                let above = self.heads[up as usize];
                if self.residuals[along as usize] <= 0.0 {
                    trees.orphan(i);
                }
                i = above;
            }
        }
        self.flow += amount;
    }

    /// Finds new parents for the orphans, or frees them.
    fn adopt(&self, trees: &mut Trees) {
        while let Some(i) = trees.orphans.pop_front() {
            let Some(side) = trees.sides[i as usize] else {
                continue;
            };
            let mut best = (u32::MAX, NONE);
            for a in self.arcs(i) {
                let j = self.heads[a as usize];
                if trees.sides[j as usize] == Some(side) && self.outward(a ^ 1, side) > 0.0 {
                    let distance = self.distance(trees, j);
                    if distance < best.0 {
                        best = (distance, a);
                    }
                }
            }
            if best.1 != NONE {
                trees.parents[i as usize] = best.1;
                trees.times[i as usize] = trees.time;
                trees.distances[i as usize] = best.0 + 1;
                continue;
            }
            trees.sides[i as usize] = None;
            trees.parents[i as usize] = NONE;
            for a in self.arcs(i) {
                let j = self.heads[a as usize];
                if trees.sides[j as usize] != Some(side) {
                    continue;
                }
                if self.outward(a ^ 1, side) > 0.0 {
                    trees.activate(j);
                }
                let parent = trees.parents[j as usize];
                if parent != TERMINAL && parent != NONE && self.heads[parent as usize] == i {
                    trees.orphan(j);
                }
            }
        }
    }

    /// Steps from node `j` to its terminal; [`u32::MAX`] where it hangs on an orphan.
    fn distance(&self, trees: &mut Trees, j: u32) -> u32 {
        let mut steps = 0;
        let mut i = j;
        let known = loop {
            if trees.times[i as usize] == trees.time && trees.parents[i as usize] != NONE {
                break trees.distances[i as usize];
            }
            match trees.parents[i as usize] {
                NONE => return u32::MAX,
                TERMINAL => {
                    trees.times[i as usize] = trees.time;
                    trees.distances[i as usize] = 1;
                    break 1;
                }
                up => i = self.heads[up as usize],
            }
            steps += 1;
        };
        let total = known + steps;
        let (mut i, mut left) = (j, total);
        while trees.times[i as usize] != trees.time {
            trees.times[i as usize] = trees.time;
            trees.distances[i as usize] = left;
            left -= 1;
            i = self.heads[trees.parents[i as usize] as usize];
        }
        total
    }
}

impl Trees {
    fn activate(&mut self, i: u32) {
        if !std::mem::replace(&mut self.queued[i as usize], true) {
            self.active.push_back(i);
        }
    }

    fn next_active(&mut self) -> Option<u32> {
        while let Some(i) = self.active.pop_front() {
            self.queued[i as usize] = false;
            if self.sides[i as usize].is_some() {
                return Some(i);
            }
        }
        None
    }

    fn orphan(&mut self, i: u32) {
        self.parents[i as usize] = NONE;
        self.orphans.push_back(i);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn cost(costs: &[[f64; 2]], edges: &[(usize, usize, f64)], sides: &[Side]) -> f64 {
        let nodes: f64 = costs
            .iter()
            .zip(sides)
            .map(|(c, side)| if *side == Side::Source { c[0] } else { c[1] })
            .sum();
        let cut: f64 = edges
            .iter()
            .filter(|e| sides[e.0] != sides[e.1])
            .map(|e| e.2)
            .sum();
        nodes + cut
    }

    #[test]
    fn least_of_all_cuts() {
        for seed in 0..300 {
            let mut random = Random::new(seed, 0);
            let n = 2 + random.below(9);
            let costs: Vec<[f64; 2]> = (0..n)
                .map(|_| [random.unit() - 0.3, 2.0 * random.unit() - 0.5])
                .collect();
            let edges: Vec<(usize, usize, f64)> = (0..random.below(3 * n))
                .map(|_| (random.below(n), random.below(n), random.unit()))
                .filter(|e| e.0 != e.1)
                .collect();
            let mut network = Network::new(n);
            for (i, c) in costs.iter().enumerate() {
                network.add_costs(i, c[0], c[1]);
            }
            for &(i, j, capacity) in &edges {
                network.add_edge(i, j, capacity);
            }
            let (value, sides) = network.minimum_cut();
            let least = (0..1_usize << n)
                .map(|bits| {
                    let sides: Vec<Side> = (0..n)
                        .map(|i| {
                            if bits >> i & 1 == 1 {
                                Side::Source
                            } else {
                                Side::Sink
                            }
                        })
                        .collect();
                    cost(&costs, &edges, &sides)
                })
                .fold(f64::INFINITY, f64::min);
            assert!(
                (cost(&costs, &edges, &sides) - least).abs() < 1e-12,
                "seed {seed}"
            );
            assert!((value - least).abs() < 1e-12, "seed {seed}");
        }
    }

    #[test]
    fn as_the_maximum_flow() {
        let (rows, columns) = (12, 40);
        for seed in 0..5 {
            let mut random = Random::new(seed, 1);
            let mut network = Network::new(rows * columns);
            let mut graph = petgraph::Graph::<(), f64>::new();
            let nodes: Vec<_> = (0..rows * columns + 2)
                .map(|_| graph.add_node(()))
                .collect();
            let [source, sink] = [rows * columns, rows * columns + 1].map(|i| nodes[i]);
            for i in 0..rows * columns {
                let [first, second] = [random.unit(), random.unit()];
                network.add_costs(i, first, second);
                graph.add_edge(nodes[i], sink, first);
                graph.add_edge(source, nodes[i], second);
                for j in [i + 1, i + columns] {
                    if j < rows * columns && (j != i + 1 || j % columns != 0) {
                        let capacity = random.unit();
                        network.add_edge(i, j, capacity);
                        graph.add_edge(nodes[i], nodes[j], capacity);
                        graph.add_edge(nodes[j], nodes[i], capacity);
                    }
                }
            }
            let (expected, _) = petgraph::algo::ford_fulkerson(&graph, source, sink);
            let (found, _) = network.minimum_cut();
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
}
