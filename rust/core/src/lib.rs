//! Phase-field segmentation of triangle surfaces: operators, functionals, flattening.
//!
//! The equations are those of "A Phase-field Approach to Variational Hierarchical Surface
//! Segmentation". Where each one lives:
//!
//! | equation | what | file |
//! |---|---|---|
//! | (1), (5) | Modica-Mortola perimeter | [`functionals::perimeter`] |
//! | (7), (9) | perimeter weighted with the parent's indicator | [`functionals::perimeter`] |
//! | (2), (10) | area of a phase, within the parent | [`functionals::area`] |
//! | (3) | connectedness | [`functionals::connectedness`] |
//! | (12), (13) | diffuse Yamabe equation, distortion and its adjoint | [`functionals::distortion`] |
//! | (13), sharp | charts by energy, all at once | [`partition`] |
//! | section 3 | the scalar functions Psi, chi, F, H | [`potentials`] |
//! | section 3 | stiffness and lumped mass | [`operators`], [`mesh`] |
//! | section 4 | textures carried by overlapping charts | [`bake`] |
//! | section 4 | chart maps (least-squares conformal, boundary-first) | [`flatten`] |
//!
//! Every functional has one shape, [`functionals::Functional`]. What depends on the surface
//! alone is built once, in [`mesh::TriangleMesh`] and [`surface::Surface`]. Results do not depend
//! on the number of threads: sums run over chunks of fixed size and are added in a fixed order.

pub mod bake;
pub mod error;
pub mod flatten;
pub mod functionals;
pub mod graph;
pub mod lbfgs;
pub mod linear;
pub mod mesh;
pub mod obj;
pub mod operators;
pub mod packing;
mod parallel;
pub mod partition;
pub mod potentials;
mod random;
pub mod raster;
pub mod repair;
pub mod simplify;
pub mod surface;
#[cfg(test)]
mod testing;

pub use error::{Error, Result};
pub use mesh::TriangleMesh;
pub use surface::Surface;
