//! Chart maps, section 4: a chart domain is cut to a disk and flattened.

mod bff;
mod chart;
mod contact;
mod cut;
mod dirichlet;
mod disk;
mod extend;
mod grow;
mod injective;
mod isometric;
mod layout;
mod lscm;
mod mend;
mod newton;
mod plane;
pub(crate) mod polygon;
mod subspace;
pub(crate) mod touch;
mod tutte;

pub use bff::{Bff, bff};
pub use chart::ChartMesh;
pub use dirichlet::symmetric_dirichlet;
pub use extend::extend;
pub use grow::{Grown, grow};
pub use injective::{Faults, faults};
pub use isometric::isometric;
pub use layout::Layout;
pub use lscm::lscm;
pub use plane::in_plane;
