//! Finite-element operators of section 3: the cotangent stiffness, plain and weighted, and the
//! systems that it makes.

mod dirichlet;
mod screened;
mod stiffness;

pub use dirichlet::DirichletSystem;
pub use screened::Screened;
pub use stiffness::Stiffness;
