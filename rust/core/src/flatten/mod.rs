//! Chart maps, section 4: a chart domain is cut to a disk and flattened.

mod bff;
mod chart;
mod cut;
mod disk;
mod lscm;

pub use bff::{Bff, bff};
pub use chart::ChartMesh;
pub use lscm::lscm;
