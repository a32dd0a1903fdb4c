//! The functionals of the paper, each a value and a gradient of the phase field `u`.

pub mod area;
pub mod connectedness;
pub mod distortion;
pub mod perimeter;

pub use area::Area;
pub use connectedness::{Connectedness, Form, Phases};
pub use distortion::{Distortion, Law};
pub use perimeter::Perimeter;

use crate::error::Result;

/// A differentiable function of the phase field (one value a vertex).
pub trait Functional: Send + Sync {
    /// Returns the value at `u` and writes the gradient, both of one entry a vertex.
    ///
    /// # Errors
    /// [`crate::Error::Length`] or [`crate::Error::NonFinite`] for an unusable `u`.
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64>;
}

#[cfg(test)]
pub(crate) mod tests {
    use super::Functional;

    /// A deterministic, irregular phase field in [-1, 1].
    pub(crate) fn noise(n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| ((i as f64 * 12.9898).sin() * 43758.5453).fract())
            .collect()
    }

    /// Compares the gradient with a central difference along an irregular direction.
    pub(crate) fn check_gradient(functional: &dyn Functional, u: &[f64], tolerance: f64) {
        let mut gradient = vec![0.0; u.len()];
        functional.value_and_gradient(u, &mut gradient).unwrap();
        let direction: Vec<f64> = (0..u.len()).map(|i| (i as f64 * 0.7 + 0.3).sin()).collect();
        let step = 1e-5;
        let mut scratch = vec![0.0; u.len()];
        let mut at = |t: f64| {
            let moved: Vec<f64> = u.iter().zip(&direction).map(|(a, d)| a + t * d).collect();
            functional.value_and_gradient(&moved, &mut scratch).unwrap()
        };
        let difference = (at(step) - at(-step)) / (2.0 * step);
        let derivative: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
        assert!(
            (difference - derivative).abs() <= tolerance * derivative.abs().max(1e-3),
            "difference {difference}, derivative {derivative}"
        );
    }
}
