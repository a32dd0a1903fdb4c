//! Perturbations: a neighbourhood is split anew, merged and relaxed, and kept where that pays.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::charts::Charts;
use super::energy::{Energies, Rule};
use super::merge::merge;
use super::relax::relax_towards;
use super::split::split;
use crate::random::Random;

/// Perturbations of one state that are tried side by side. A fixed number, so that the outcome
/// does not depend on the threads.
const BATCH: usize = 2;
/// Least gain of a perturbation.
const GAIN: f64 = 1e-4;
/// Sweeps after a split.
const SWEEPS: usize = 4;
/// Growth of the energy by a split that no relaxing has made good, relative to the energy. Those of 15
/// perturbations that paid were at most 0.13.
const WORST: f64 = 0.15;
/// Weights of the normals in the split.
const NORMALS: [f64; 3] = [0.5, 1.0, 2.0];
/// Part of the mean piece below which a piece joins another.
const SMALLEST: f64 = 0.05;
/// Most distortion with which a chart counts where one is drawn.
const MOST: f64 = 0.02;

/// Tries `count` perturbations, numbered from `first`; how many were kept.
pub(super) fn perturb(
    energies: &Energies,
    charts: &mut Charts,
    rule: &Rule,
    seed: u64,
    trials: std::ops::Range<usize>,
) -> usize {
    let mut kept = 0;
    let all: Vec<usize> = trials.collect();
    for batch in all.chunks(BATCH) {
        let before = charts.energy(rule);
        let mut outcomes: Vec<(f64, Charts)> = batch
            .par_iter()
            .filter_map(|&trial| {
                let mut random = Random::new(seed, trial as u64);
                let outcome = trial_of(energies, charts, rule, before, &mut random)?;
                let gain = before - outcome.energy(rule);
                (gain > GAIN).then_some((gain, outcome))
            })
            .collect();
        outcomes.sort_by(|x, y| y.0.total_cmp(&x.0));
        let base = charts.clone();
        let mut touched = BTreeSet::new();
        for (_, outcome) in outcomes {
            let theirs: BTreeSet<u128> = outcome.charts.iter().map(|chart| chart.hash).collect();
            let gone: BTreeSet<u128> = base
                .charts
                .iter()
                .map(|chart| chart.hash)
                .filter(|hash| !theirs.contains(hash))
                .collect();
            if !gone.is_disjoint(&touched) {
                continue;
            }
            let ours: BTreeSet<u128> = base.charts.iter().map(|chart| chart.hash).collect();
            let added = outcome
                .charts
                .into_iter()
                .filter(|chart| !ours.contains(&chart.hash))
                .collect();
            let removed: Vec<u32> = (0..)
                .zip(&charts.charts)
                .filter(|(_, chart)| gone.contains(&chart.hash))
                .map(|(label, _)| label)
                .collect();
            charts.exchange(&removed, added);
            touched.extend(gone);
            kept += 1;
        }
    }
    kept
}

/// One perturbation of charts of the given energy; none where it leads back or too far.
fn trial_of(
    energies: &Energies,
    charts: &Charts,
    rule: &Rule,
    before: f64,
    random: &mut Random,
) -> Option<Charts> {
    let weights: Vec<f64> = charts
        .charts
        .iter()
        .map(|chart| {
            rule.distortion * chart.terms.distortion.min(MOST) + 0.5 * chart.terms.perimeter
        })
        .collect();
    let mut group = vec![random.weighted(&weights) as u32];
    let seams = charts.seams(&energies.geometry);
    for _ in 0..random.below(3) {
        let around: BTreeSet<u32> = seams
            .keys()
            .filter_map(|&(a, b)| match (group.contains(&a), group.contains(&b)) {
                (true, false) => Some(b),
                (false, true) => Some(a),
                _ => None,
            })
            .collect();
        if !around.is_empty() {
            let pick = random.below(around.len());
            group.extend(around.into_iter().nth(pick));
        }
    }
    let count = 2 * group.len() + random.below(2);
    let mut faces: Vec<u32> = group
        .iter()
        .flat_map(|&a| charts.charts[a as usize].faces.iter().copied())
        .collect();
    faces.sort_unstable();
    let normals = NORMALS[random.below(NORMALS.len())];
    let smallest = SMALLEST * energies.geometry.area_of(&faces) / count as f64;
    let parts = split(energies, &faces, count, normals, smallest, random);
    let mut outcome = charts.clone();
    let parts = parts
        .into_par_iter()
        .map(|faces| energies.chart(faces, rule))
        .collect();
    outcome.exchange(&group, parts);
    let mut outcome = merge(energies, &outcome, rule);
    let after = outcome.energy(rule);
    if after > (1.0 + WORST) * before || (after - before).abs() < GAIN {
        return None;
    }
    let active: BTreeSet<u32> = faces.iter().map(|&f| outcome.labels[f as usize]).collect();
    relax_towards(energies, &mut outcome, rule, active, SWEEPS, before);
    Some(merge(energies, &outcome, rule))
}
