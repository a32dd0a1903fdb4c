//! Chart maps, section 4: a chart domain is cut to a disk and flattened.

mod chart;
mod cut;
mod lscm;

pub use chart::ChartMesh;
pub use lscm::lscm;
