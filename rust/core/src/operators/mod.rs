//! Finite-element operators of section 3: the cotangent stiffness, plain and weighted.

mod lower_triangle;
mod stiffness;

pub use lower_triangle::LowerTriangle;
pub use stiffness::{Stiffness, StiffnessPattern};
