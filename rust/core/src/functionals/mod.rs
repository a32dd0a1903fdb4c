//! The functionals of the paper, each a value and a gradient of the phase field `u`.

pub mod area;
pub mod connectedness;
pub mod distortion;
mod functional;
pub mod perimeter;

pub use area::Area;
pub use connectedness::{Connectedness, Form, Phases};
pub use distortion::{Distortion, Formulation};
pub use functional::Functional;
pub use perimeter::{Parent, Perimeter};
