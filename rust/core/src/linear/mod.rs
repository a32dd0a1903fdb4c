//! Sparse linear solvers.

pub mod cholesky;
mod ordering;
mod supernodal;

pub use cholesky::{Analysis, Cholesky, Factorisation, Ordering};
