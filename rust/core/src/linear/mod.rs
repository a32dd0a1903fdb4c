//! Sparse linear solvers.

pub mod cholesky;

pub use cholesky::{Analysis, Cholesky, Factorisation};
