//! The distances between all pairs of components.

use super::phase::Phase;
use crate::graph::AllPairs;

/// The searches between all pairs, and buffers.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    paths: AllPairs,
    /// what counts for each mass
    saturated: Vec<f64>,
}

impl Pairs {
    /// The sum over ordered pairs i != j of W_i W_j d_ij. Leaves its derivative by the masses in
    /// `potential`; calls `add(f, a)` for every face f whose price enters with factor a.
    pub(super) fn sum(
        &mut self,
        phase: &Phase<'_>,
        potential: &mut [f64],
        add: impl FnMut(u32, f64),
    ) -> f64 {
        let saturation = phase.saturation;
        self.saturated.clear();
        self.saturated
            .extend(phase.masses.iter().map(|&mass| saturation.at(mass).0));
        self.paths.search(phase.graph, phase.regions);
        self.paths.differentiate(&self.saturated, potential);
        self.paths.accumulate_paths(phase.mesh, phase.weights, add);
        let mut value = 0.0;
        for ((row, &weight), &mass) in potential.iter_mut().zip(&self.saturated).zip(phase.masses) {
            value += 0.5 * weight * *row;
            *row *= saturation.at(mass).1;
        }
        value
    }
}
