//! What the ways of measuring the distances between components start from.

use crate::graph::{ContractedDual, DualWeights, Regions};
use crate::mesh::TriangleMesh;

/// One phase: the masses of its components, the prices of the ways between them, and the regions
/// that grew from them.
pub(super) struct Phase<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) weights: DualWeights<'a>,
    pub(super) masses: &'a [f64],
    pub(super) saturation: Saturation,
    pub(super) graph: &'a ContractedDual,
    pub(super) regions: &'a Regions,
}

/// The area w of the masses W / (W + w); without one a mass counts as it is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Saturation(pub(super) Option<f64>);

impl Saturation {
    /// What counts for the mass W, and its derivative.
    pub(super) fn at(self, mass: f64) -> (f64, f64) {
        match self.0 {
            None => (mass, 1.0),
            Some(area) => {
                let sum = mass + area;
                (mass / sum, area / (sum * sum))
            }
        }
    }
}
