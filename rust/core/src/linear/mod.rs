//! Sparse linear solvers.

mod cholesky;
mod memory;
mod ordering;
mod supernodal;
mod symbolic;

pub use cholesky::Cholesky;
pub use ordering::Ordering;
pub use symbolic::{Factorisation, SymbolicFactorisation};
