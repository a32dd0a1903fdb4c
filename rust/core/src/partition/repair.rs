//! Charts whose maps are no bijections are split until none is left; charts too small are joined.

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use super::charts::{Charts, pieces};
use super::energy::{Chart, Energies, Rule, SMALLEST};
use super::marks::union;
use super::split::split;
use crate::random::Random;

/// Splits of one chart that are compared.
const TRIALS: u64 = 8;
/// Part of the mean piece below which a piece joins another.
const CRUMB: f64 = 0.05;

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

/// The charts that the rule forbids.
pub(super) fn failing(charts: &Charts, rule: &Rule) -> Vec<u32> {
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
            let smallest = CRUMB * chart.terms.area / count as f64;
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

/// Sees to it that no chart is tiny: each is joined to a neighbour, or takes faces from its neighbours,
/// whichever costs less, where the rule allows one of the two. Returns how many there were.
pub(super) fn resize_tiny(energies: &Energies, charts: &mut Charts, rule: &Rule) -> usize {
    let mut count = 0;
    let mut done = BTreeSet::new();
    loop {
        let tiny = (0..)
            .zip(&charts.charts)
            .filter(|(_, chart)| chart.terms.area < SMALLEST && !done.contains(&chart.hash))
            .min_by(|x, y| x.1.terms.area.total_cmp(&y.1.terms.area));
        let Some((label, chart)) = tiny else {
            return count;
        };
        count += 1;
        done.insert(chart.hash);
        let cost = |list: &[Arc<Chart>]| list.iter().map(|c| rule.cost(&c.terms)).sum::<f64>();
        let best = joined(energies, charts, rule, label)
            .into_iter()
            .chain(grown(energies, charts, rule, label))
            .map(|(labels, added)| {
                let before: f64 = labels
                    .iter()
                    .map(|&label| rule.cost(&charts.charts[label as usize].terms))
                    .sum();
                (cost(&added) - before, labels, added)
            })
            .filter(|(change, ..)| change.is_finite())
            .min_by(|x, y| x.0.total_cmp(&y.0));
        if let Some((_, labels, added)) = best {
            charts.exchange(&labels, added);
        }
    }
}

/// Charts and those that take their place.
type Exchange = (Vec<u32>, Vec<Arc<Chart>>);

/// The chart with each of its neighbours.
fn joined(energies: &Energies, charts: &Charts, rule: &Rule, label: u32) -> Vec<Exchange> {
    let faces = &charts.charts[label as usize].faces;
    charts
        .seams(&energies.geometry)
        .keys()
        .filter(|pair| pair.0 == label || pair.1 == label)
        .map(|&(a, b)| if a == label { b } else { a })
        .map(|other| {
            let both = union(faces, &charts.charts[other as usize].faces);
            (vec![label, other], vec![energies.chart(both, rule)])
        })
        .collect()
}

/// The chart with faces around it, ring by ring, until it is large enough; none where that tears
/// a neighbour apart.
fn grown(energies: &Energies, charts: &Charts, rule: &Rule, label: u32) -> Option<Exchange> {
    let geometry = &energies.geometry;
    let chart = &charts.charts[label as usize];
    let mut taken: BTreeSet<u32> = chart.faces.iter().copied().collect();
    let mut ring = chart.faces.clone();
    let mut area = chart.terms.area;
    while area < SMALLEST {
        let next: BTreeSet<u32> = ring
            .iter()
            .flat_map(|&f| geometry.around(f as usize).map(|(_, g)| g as u32))
            .filter(|g| !taken.contains(g))
            .collect();
        if next.is_empty() {
            return None;
        }
        ring = next.into_iter().collect();
        area += geometry.area_of(&ring);
        taken.extend(&ring);
    }
    let donors: BTreeSet<u32> = taken.iter().map(|&f| charts.labels[f as usize]).collect();
    let mut added = vec![energies.chart(taken.iter().copied().collect(), rule)];
    for &donor in donors.iter().filter(|&&donor| donor != label) {
        let faces = &charts.charts[donor as usize].faces;
        let left: Vec<u32> = faces
            .iter()
            .copied()
            .filter(|f| !taken.contains(f))
            .collect();
        if energies
            .with_marks(|marks| pieces(geometry, &left, marks, |_| ()))
            .len()
            != 1
        {
            return None;
        }
        added.push(energies.chart(left, rule));
    }
    Some((donors.into_iter().collect(), added))
}
