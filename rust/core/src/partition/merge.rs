//! Merging of adjacent charts, the best pair first, while the energy falls.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::sync::Arc;

use rayon::prelude::*;

use super::charts::Charts;
use super::energy::{Chart, Energies, Rule};
use super::marks::union;

#[derive(PartialEq)]
struct Candidate {
    change: f64,
    pair: (u32, u32),
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.change
            .total_cmp(&other.change)
            .then(self.pair.cmp(&other.pair))
    }
}

/// A merge of two charts; each later chart has the next number after those at the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merge {
    /// The charts, the smaller number first.
    pub pair: (u32, u32),
    /// The energy of all charts after it.
    pub energy: f64,
}

/// Merges while that lowers the energy.
pub(super) fn merge(energies: &Energies, charts: &Charts, rule: &Rule) -> Charts {
    let (alive, merges) = run(energies, charts, rule, false);
    if merges.is_empty() {
        return charts.clone();
    }
    let mut result = Charts {
        labels: charts.labels.clone(),
        charts: Vec::new(),
    };
    result.exchange(&[], alive.into_values().collect());
    result
}

/// The merges, the best pair first although the energy rises, until no charts are adjacent.
pub(super) fn order(energies: &Energies, charts: &Charts, rule: &Rule) -> Vec<Merge> {
    run(energies, charts, rule, true).1
}

/// The charts in the end and how they came about; `all` goes on although the energy rises.
fn run(
    energies: &Energies,
    charts: &Charts,
    rule: &Rule,
    all: bool,
) -> (BTreeMap<u32, Arc<Chart>>, Vec<Merge>) {
    let mut alive: BTreeMap<u32, Arc<Chart>> = (0..).zip(charts.charts.iter().cloned()).collect();
    let mut around: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    let pairs: Vec<(u32, u32)> = charts.seams(&energies.geometry).into_keys().collect();
    for &(a, b) in &pairs {
        around.entry(a).or_default().insert(b);
        around.entry(b).or_default().insert(a);
    }
    let mut heap: BinaryHeap<Reverse<Candidate>> =
        candidates(energies, &alive, &pairs, rule, all).into();
    let mut fresh = charts.len() as u32;
    let mut merges = Vec::new();
    while let Some(Reverse(Candidate { pair: (a, b), .. })) = heap.pop() {
        if !alive.contains_key(&a) {
            continue;
        }
        let Some(second) = alive.remove(&b) else {
            continue;
        };
        let Some(first) = alive.remove(&a) else {
            continue;
        };
        let chart = energies.chart(union(&first.faces, &second.faces), rule);
        alive.insert(fresh, chart);
        merges.push(Merge {
            pair: (a, b),
            energy: alive.values().map(|chart| rule.cost(&chart.terms)).sum(),
        });
        let mut neighbours = around.remove(&a).unwrap_or_default();
        neighbours.append(&mut around.remove(&b).unwrap_or_default());
        neighbours.remove(&a);
        neighbours.remove(&b);
        for c in &neighbours {
            if let Some(theirs) = around.get_mut(c) {
                theirs.remove(&a);
                theirs.remove(&b);
                theirs.insert(fresh);
            }
        }
        let pairs: Vec<(u32, u32)> = neighbours.iter().map(|&c| (c, fresh)).collect();
        around.insert(fresh, neighbours);
        heap.extend(candidates(energies, &alive, &pairs, rule, all));
        fresh += 1;
    }
    (alive, merges)
}

fn candidates(
    energies: &Energies,
    alive: &BTreeMap<u32, Arc<Chart>>,
    pairs: &[(u32, u32)],
    rule: &Rule,
    all: bool,
) -> Vec<Reverse<Candidate>> {
    pairs
        .par_iter()
        .filter_map(|&(a, b)| {
            let (first, second) = (&alive[&a], &alive[&b]);
            let apart = rule.cost(&first.terms) + rule.cost(&second.terms);
            let together = if all {
                energies.cost_of_any_union(first, second, rule)
            } else {
                // Nothing is gained by a merge of what is forbidden.
                apart
                    .is_finite()
                    .then(|| energies.cost_of_union(first, second, rule, apart))??
            };
            Some(Reverse(Candidate {
                change: together - apart,
                pair: (a, b),
            }))
        })
        .collect()
}
