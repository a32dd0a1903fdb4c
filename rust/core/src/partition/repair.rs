//! Charts whose maps are no bijections are split until none is left; charts too small are joined.

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use super::charts::{Charts, union};
use super::energy::{Chart, Energies, Rule};
use super::random::Random;
use super::split::split;

/// Splits of one chart that are compared.
const TRIALS: u64 = 8;
/// Part of the mean piece below which a piece joins another.
const SMALLEST: f64 = 0.05;

/// Splits the charts that the rule forbids, in `count` parts or a few more. Returns how many there
/// were.
pub(super) fn split_failing(
    energies: &Energies,
    charts: &mut Charts,
    rule: &Rule,
    count: usize,
) -> usize {
    let bad = failing(charts, rule);
    if !bad.is_empty() {
        let parts: Vec<Arc<Chart>> = bad
            .par_iter()
            .flat_map_iter(|&label| {
                best_split(energies, &charts.charts[label as usize], rule, count)
            })
            .collect();
        charts.exchange(&bad, parts);
    }
    bad.len()
}

fn failing(charts: &Charts, rule: &Rule) -> Vec<u32> {
    (0..)
        .zip(&charts.charts)
        .filter(|(_, chart)| !rule.cost(&chart.terms).is_finite())
        .map(|(label, _)| label)
        .collect()
}

/// The split with the fewest parts that fail, and among those with the least energy.
fn best_split(energies: &Energies, chart: &Chart, rule: &Rule, count: usize) -> Vec<Arc<Chart>> {
    let splits: Vec<Vec<Arc<Chart>>> = (0..TRIALS)
        .into_par_iter()
        .map(|trial| {
            let mut random = Random::new(chart.hash as u64, trial);
            let normals = [0.5, 1.0, 2.0][random.below(3)];
            let smallest = SMALLEST * chart.area / count as f64;
            split(
                energies,
                &chart.faces,
                count,
                normals,
                smallest,
                &mut random,
            )
            .into_iter()
            .map(|faces| energies.chart(faces, rule))
            .collect()
        })
        .collect();
    let rating = |parts: &[Arc<Chart>]| {
        let costs = || parts.iter().map(|part| rule.cost(&part.terms));
        let failing = costs().filter(|cost| !cost.is_finite()).count();
        (
            failing,
            costs().filter(|cost| cost.is_finite()).sum::<f64>(),
        )
    };
    let mut best = (0, rating(&splits[0]));
    for (i, parts) in splits.iter().enumerate().skip(1) {
        let rated = rating(parts);
        if rated.0 < best.1.0 || (rated.0 == best.1.0 && rated.1 < best.1.1) {
            best = (i, rated);
        }
    }
    splits.into_iter().nth(best.0).unwrap_or_default()
}

/// Joins charts below an area to the neighbour with which they cost least, where the rule allows
/// it. Returns how many.
pub(super) fn join_tiny(
    energies: &Energies,
    charts: &mut Charts,
    rule: &Rule,
    smallest: f64,
) -> usize {
    let mut joined = 0;
    let mut stuck = BTreeSet::new();
    loop {
        let tiny = (0..)
            .zip(&charts.charts)
            .filter(|(_, chart)| chart.area < smallest && !stuck.contains(&chart.hash))
            .min_by(|x, y| x.1.area.total_cmp(&y.1.area))
            .map(|(label, _): (u32, _)| label);
        let Some(label) = tiny else { return joined };
        let chart = charts.charts[label as usize].clone();
        let best = charts
            .seams(&energies.geometry)
            .keys()
            .filter(|pair| pair.0 == label || pair.1 == label)
            .map(|&(a, b)| if a == label { b } else { a })
            .map(|other| {
                let theirs = &charts.charts[other as usize];
                let both = energies.chart(union(&chart.faces, &theirs.faces), rule);
                (
                    rule.cost(&both.terms) - rule.cost(&theirs.terms),
                    other,
                    both,
                )
            })
            .filter(|(change, ..)| change.is_finite())
            .min_by(|x, y| x.0.total_cmp(&y.0));
        match best {
            Some((_, other, both)) => {
                charts.exchange(&[label, other], vec![both]);
                joined += 1;
            }
            None => {
                stuck.insert(chart.hash);
            }
        }
    }
}
