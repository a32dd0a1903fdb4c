//! Finite-element operators of section 3: the cotangent stiffness, plain and weighted, and the
//! systems that it makes.

mod dirichlet;
mod stiffness;

pub use dirichlet::DirichletSystem;
pub use stiffness::Stiffness;
