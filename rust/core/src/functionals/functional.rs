//! What all functionals have in common.

use crate::error::Result;

/// A differentiable function of the phase field (one value a vertex).
pub trait Functional: Send + Sync {
    /// Returns the value at `u` and writes the gradient, both of one entry a vertex.
    ///
    /// # Errors
    /// [`crate::Error::Length`] or [`crate::Error::NonFinite`] for an unusable `u`.
    fn value_and_gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64>;
}
