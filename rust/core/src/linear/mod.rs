//! Sparse linear solvers.

pub mod cholesky;

pub use cholesky::{Cholesky, Factorisation};
