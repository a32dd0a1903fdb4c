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
mod marks;
mod merge;
mod perturb;
mod relax;
mod repair;
mod split;

pub use energy::{Rule, Terms};
pub use merge::Merge;

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::error::{Error, Result, check_length};
use crate::surface::Surface;
use charts::Charts;
use energy::Energies;
use geometry::Geometry;
use relax::Memory;

/// Sums over the charts of a partition, on the surface of unit area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// The energy E.
    pub energy: f64,
    /// Number of charts.
    pub charts: usize,
    /// Length of the edges between charts.
    pub seam: f64,
    /// Length of the cuts that open charts to disks.
    pub cuts: f64,
    /// Integral of the squared log scale.
    pub distortion: f64,
    /// Area that boundaries of maps cover more than once.
    pub overlap: f64,
    /// Charts whose map is known to be no bijection.
    pub overlapping: usize,
    /// Area of the smallest chart.
    pub smallest: f64,
}

/// A partition of a surface into connected charts, and the moves that improve it.
pub struct Partition {
    energies: Energies,
    /// Labels that have not been looked at yet.
    given: Vec<u32>,
    /// Their pieces, once a move or a figure has asked for them.
    charts: OnceLock<Charts>,
    rule: Rule,
    memory: Memory,
}

impl Partition {
    /// Starts from a single chart.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(surface: &Surface, distortion: f64) -> Result<Self> {
        let energies = Energies::new(Geometry::new(surface)?);
        let rule = Rule {
            distortion,
            injective: false,
            upright: true,
        };
        Ok(Self {
            given: vec![0; surface.mesh().n_faces()],
            charts: OnceLock::new(),
            energies,
            rule,
            memory: Memory::new(0.0),
        })
    }

    /// Starts anew from the connected pieces of equal label.
    ///
    /// Labels that come from another surface of the same shape have boundaries that are good to about
    /// `reach` mean edge lengths: so wide are the first bands, and pieces below a thousandth of the
    /// area go to the neighbour along the longest boundary. A `reach` of zero leaves them as they are.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for labels that are not one a face.
    pub fn set_labels(&mut self, labels: &[i64], reach: f64) -> Result<()> {
        check_length("labels", labels.len(), self.labels().len())?;
        let mut labels = distinct(labels);
        self.unite(&mut labels);
        if reach > 0.0 {
            labels = self.joined(&labels);
        }
        self.memory = Memory::new(reach);
        self.give(&labels);
        Ok(())
    }

    /// Starts anew from labels of another surface of the same shape where boundaries are at rest.
    ///
    /// Boundaries are drawn straight within `reach` mean edge lengths, by lengths and the given
    /// [`Self::sensitivities`] of the other surface alone: no map is computed until a figure or a
    /// move asks for it.
    ///
    /// # Errors
    /// [`crate::Error::Length`] for labels or sensitivities that are not one a face.
    pub fn carry_labels(
        &mut self,
        labels: &[i64],
        sensitivities: &[f64],
        reach: f64,
    ) -> Result<()> {
        check_length("labels", labels.len(), self.labels().len())?;
        check_length("sensitivities", sensitivities.len(), labels.len())?;
        let mut labels = distinct(labels);
        self.unite(&mut labels);
        let pieces = self.pieces(&self.joined(&labels));
        let labels = relax::carried(
            &self.energies,
            numbered(&pieces, labels.len()),
            pieces,
            sensitivities,
            self.rule.distortion,
            reach,
        );
        self.memory = Memory::new(reach);
        self.give(&labels);
        Ok(())
    }

    /// Change of the distortion for each area that its chart gains at its boundary, at each face.
    #[must_use]
    pub fn sensitivities(&self) -> Vec<f64> {
        let charts = &self.charts().charts;
        let of_charts: Vec<&[f64]> = charts
            .par_iter()
            .map(|chart| self.energies.sensitivity(chart))
            .collect();
        let mut values = vec![0.0; self.labels().len()];
        for (chart, of_chart) in charts.iter().zip(of_charts) {
            for (&f, &value) in chart.faces.iter().zip(of_chart) {
                values[f as usize] = value;
            }
        }
        values
    }

    /// From now on the exact energy of so many cuts of a boundary is asked for in a sweep, at most,
    /// until other labels are set.
    pub fn limit_tries(&mut self, tries: usize) {
        self.memory.tries = tries;
    }

    fn give(&mut self, labels: &[u32]) {
        self.given = numbered(&self.pieces(labels), labels.len());
        self.charts = OnceLock::new();
    }

    fn charts(&self) -> &Charts {
        self.charts
            .get_or_init(|| Charts::new(&self.energies, &self.given, &self.rule))
    }

    /// The charts, to be put back by [`Self::keep`].
    fn take(&mut self) -> Charts {
        self.charts();
        self.charts
            .take()
            .unwrap_or_else(|| Charts::new(&self.energies, &self.given, &self.rule))
    }

    fn keep(&mut self, charts: Charts) {
        self.charts = OnceLock::from(charts);
    }

    /// The connected pieces of equal label, in the order of their first faces.
    fn pieces(&self, labels: &[u32]) -> Vec<Vec<u32>> {
        let all: Vec<u32> = (0..labels.len() as u32).collect();
        let geometry = &self.energies.geometry;
        self.energies
            .with_marks(|marks| charts::pieces(geometry, &all, marks, |f| labels[f]))
    }

    /// Labels of the connected pieces of equal label, small ones joined to others.
    fn joined(&self, labels: &[u32]) -> Vec<u32> {
        let geometry = &self.energies.geometry;
        let pieces = charts::join_small(geometry, self.pieces(labels), energy::SMALLEST);
        numbered(&pieces, labels.len())
    }

    /// Starts anew from about `count` cells of similar normals.
    pub fn set_cells(&mut self, count: usize) {
        let mut labels = cells::cells(&self.energies.geometry, count);
        self.unite(&mut labels);
        self.memory = Memory::new(0.0);
        self.replace(Charts::new(&self.energies, &labels, &self.rule));
    }

    fn unite(&self, labels: &mut [u32]) {
        let faces: Vec<u32> = (0..labels.len() as u32).collect();
        self.energies.geometry.unite(&faces, labels);
    }

    fn replace(&mut self, charts: Charts) {
        self.keep(charts);
        self.memory.clear();
    }

    /// Chart of each face, from 0.
    #[must_use]
    pub fn labels(&self) -> &[u32] {
        self.charts
            .get()
            .map_or(&self.given, |charts| &charts.labels)
    }

    /// The sums of the partition as it is now.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let charts = &self.charts().charts;
        let sum = |term: fn(&Terms) -> f64| charts.iter().map(|c| term(&c.terms)).sum::<f64>();
        Figures {
            energy: self.charts().energy(&self.rule),
            charts: charts.len(),
            seam: 0.5 * sum(|t| t.perimeter),
            cuts: sum(|t| t.cut),
            distortion: sum(|t| t.distortion),
            overlap: sum(|t| t.overlap),
            overlapping: charts
                .iter()
                .filter(|c| !c.terms.simple || c.terms.flips.is_some_and(|n| n > 0))
                .count(),
            smallest: charts
                .iter()
                .map(|c| c.terms.area)
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Merges charts while the energy falls.
    pub fn merge(&mut self) {
        self.replace(merge::merge(&self.energies, self.charts(), &self.rule));
    }

    /// The merges of charts until no two are adjacent, the best first although the energy rises; the
    /// partition itself stays as it is.
    #[must_use]
    pub fn merges(&self) -> Vec<Merge> {
        merge::order(&self.energies, self.charts(), &self.rule)
    }

    /// Moves each boundary once; the next sweep knows which have come to rest. Whether more moves
    /// are worth while.
    pub fn sweep(&mut self) -> bool {
        let mut charts = self.take();
        let gain = relax::sweep(&self.energies, &mut charts, &self.rule, &mut self.memory);
        let more = !relax::at_rest(gain, charts.energy(&self.rule));
        self.keep(charts);
        more
    }

    /// Tries the perturbations of the given numbers; how many were kept.
    pub fn perturb(&mut self, seed: u64, trials: std::ops::Range<usize>) -> usize {
        self.memory.clear();
        let mut charts = self.take();
        let kept = perturb::perturb(&self.energies, &mut charts, &self.rule, seed, trials);
        self.keep(charts);
        kept
    }

    /// From now on an overlap costs in proportion to its area.
    pub fn allow_overlap(&mut self) {
        self.rule.injective = false;
        self.memory.clear();
    }

    /// From now on a chart that overlaps itself, or, where it is to be `upright`, has faces turned
    /// over, costs infinitely much.
    pub fn forbid_overlap(&mut self, upright: bool) {
        self.rule.injective = true;
        self.rule.upright = upright;
        if let Some(charts) = self.charts.get() {
            self.replace(charts.under(&self.energies, &self.rule));
        }
    }

    /// The charts that cost infinitely much.
    #[must_use]
    pub fn failing(&self) -> Vec<u32> {
        repair::failing(self.charts(), &self.rule)
    }

    /// Lets charts count as overlapping themselves, as they do on a finer surface.
    ///
    /// # Errors
    /// [`crate::Error::Index`] for a label that no chart has.
    pub fn condemn(&mut self, labels: &[i64]) -> Result<()> {
        let count = self.charts().len();
        for (position, &label) in labels.iter().enumerate() {
            let chart = usize::try_from(label)
                .ok()
                .and_then(|label| self.charts().charts.get(label));
            let chart = chart.ok_or(Error::Index {
                argument: "labels",
                position,
                index: label,
                count,
            })?;
            self.energies.condemn(chart);
        }
        let charts = self.charts().under(&self.energies, &self.rule);
        self.replace(charts);
        Ok(())
    }

    /// Splits the charts that cost infinitely much in about `count` parts; how many there were.
    pub fn split_failing(&mut self, count: usize) -> usize {
        self.memory.clear();
        let mut charts = self.take();
        let failing = repair::split_failing(&self.energies, &mut charts, &self.rule, count);
        self.keep(charts);
        failing
    }

    /// Joins charts below a thousandth of the area to neighbours, or lets them grow; how many there
    /// were.
    pub fn resize_tiny(&mut self) -> usize {
        self.memory.clear();
        let mut charts = self.take();
        let tiny = repair::resize_tiny(&self.energies, &mut charts, &self.rule);
        self.keep(charts);
        tiny
    }

    /// Weighs the distortion anew.
    pub fn set_distortion(&mut self, distortion: f64) {
        self.rule.distortion = distortion;
        self.memory.clear();
    }
}

/// The number of the piece of each face.
fn numbered(pieces: &[Vec<u32>], n_faces: usize) -> Vec<u32> {
    let mut labels = vec![0; n_faces];
    for (label, piece) in (0..).zip(pieces) {
        for &f in piece {
            labels[f as usize] = label;
        }
    }
    labels
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
