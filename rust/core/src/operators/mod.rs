//! Finite-element operators of section 3: the cotangent stiffness, plain and weighted.

mod stiffness;

pub use stiffness::{Stiffness, StiffnessPattern};
