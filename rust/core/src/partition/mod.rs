//! Charts by energy: labels of the faces that minimise seam, cuts and distortion together.
//!
//! E = (seam + cuts) / sqrt A + omega (integral of s^2 + overlap / 4) / A + charts / 10, summed over
//! charts that are cut to disks; s is the log scale of the conformal map that keeps lengths on the
//! boundary of a chart. It is the sharp limit of problem (13) without the area constraint, over all
//! charts at once. Every move is judged by the exact difference of E.

mod cells;
mod charts;
mod cut;
mod disk;
mod energy;
mod factor;
mod flow;
mod geometry;
mod merge;
mod perturb;
mod polygon;
mod random;
mod relax;
mod repair;
mod split;

pub use energy::{Rule, Terms};

use crate::error::Result;
use crate::surface::Surface;
use charts::Charts;
use energy::Energies;
use geometry::Geometry;

/// Sums over the charts of a partition, on the surface of unit area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    pub energy: f64,
    pub charts: usize,
    pub seam: f64,
    pub cuts: f64,
    pub distortion: f64,
    pub overlap: f64,
    /// Charts whose map is known to be no bijection.
    pub overlapping: usize,
    /// Area of the smallest chart.
    pub smallest: f64,
}

/// A partition of a surface into connected charts, and the moves that improve it.
pub struct Partition {
    energies: Energies,
    charts: Charts,
    rule: Rule,
}

impl Partition {
    /// Starts from the connected pieces of equal label.
    ///
    /// # Errors
    /// [`Error::Length`] for labels that are not one a face, [`Error::OutOfMemory`].
    pub fn new(surface: &Surface, labels: &[i64], distortion: f64) -> Result<Self> {
        crate::error::check_length("labels", labels.len(), surface.mesh().n_faces())?;
        let energies = Energies::new(Geometry::new(surface)?);
        let rule = Rule {
            distortion,
            injective: false,
        };
        let labels = distinct(labels);
        let charts = Charts::new(&energies, &labels, &rule);
        Ok(Self {
            energies,
            charts,
            rule,
        })
    }

    /// Starts from about `count` cells of similar normals.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn of_cells(surface: &Surface, count: usize, distortion: f64) -> Result<Self> {
        let energies = Energies::new(Geometry::new(surface)?);
        let rule = Rule {
            distortion,
            injective: false,
        };
        let labels = cells::cells(&energies.geometry, count);
        let charts = Charts::new(&energies, &labels, &rule);
        Ok(Self {
            energies,
            charts,
            rule,
        })
    }

    /// Chart of each face, from 0.
    pub fn labels(&self) -> &[u32] {
        &self.charts.labels
    }

    pub fn figures(&self) -> Figures {
        let charts = &self.charts.charts;
        let sum = |term: fn(&Terms) -> f64| charts.iter().map(|c| term(&c.terms)).sum::<f64>();
        Figures {
            energy: self.charts.energy(&self.rule),
            charts: charts.len(),
            seam: 0.5 * sum(|t| t.perimeter),
            cuts: sum(|t| t.cut),
            distortion: sum(|t| t.distortion),
            overlap: sum(|t| t.overlap),
            overlapping: charts
                .iter()
                .filter(|c| !c.terms.simple || c.terms.flips.is_some_and(|n| n > 0))
                .count(),
            smallest: charts.iter().map(|c| c.area).fold(f64::INFINITY, f64::min),
        }
    }

    /// Gives pieces below a part of the area to the neighbour along the longest boundary.
    pub fn join_small(&mut self, smallest: f64) {
        let pieces = self.charts.charts.iter().map(|c| c.faces.clone()).collect();
        let pieces = charts::join_small(&self.energies.geometry, pieces, smallest);
        let mut labels = vec![0; self.charts.labels.len()];
        for (label, piece) in (0..).zip(&pieces) {
            for &f in piece {
                labels[f as usize] = label;
            }
        }
        self.charts = Charts::new(&self.energies, &labels, &self.rule);
    }

    /// Merges charts while the energy falls.
    pub fn merge(&mut self) {
        self.charts = merge::merge(&self.energies, &self.charts, &self.rule);
    }

    /// Moves the boundaries while the energy falls, at most `limit` times each.
    pub fn relax(&mut self, limit: usize) -> f64 {
        relax::relax(
            &self.energies,
            &mut self.charts,
            &self.rule,
            None,
            limit,
            f64::INFINITY,
        )
    }

    /// Tries the perturbations of the given numbers; how many were kept.
    pub fn perturb(&mut self, seed: u64, trials: std::ops::Range<usize>) -> usize {
        perturb::perturb(&self.energies, &mut self.charts, &self.rule, seed, trials)
    }

    /// From now on no chart may overlap itself or have faces turned over: those that do are split
    /// and relaxed until none is left. Returns how many did.
    pub fn make_injective(&mut self) -> usize {
        self.rule.injective = true;
        repair::make_injective(&self.energies, &mut self.charts, &self.rule)
    }

    /// Joins charts below a part of the area to neighbours; how many.
    pub fn join_tiny(&mut self, smallest: f64) -> usize {
        repair::join_tiny(&self.energies, &mut self.charts, &self.rule, smallest)
    }

    /// Weighs the distortion anew.
    pub fn set_distortion(&mut self, distortion: f64) {
        self.rule.distortion = distortion;
    }
}

/// Labels numbered from 0 in the order of the values.
fn distinct(labels: &[i64]) -> Vec<u32> {
    let mut values = labels.to_vec();
    values.sort_unstable();
    values.dedup();
    labels
        .iter()
        .map(|label| values.partition_point(|value| value < label) as u32)
        .collect()
}
