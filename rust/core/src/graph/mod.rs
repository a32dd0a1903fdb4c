//! Searches on the dual graph: components of faces, shortest paths between them and the
//! shortest tree that joins them.

mod components;
mod dual;
mod network;
mod radix_heap;
mod regions;
mod sharing;
mod shortest_paths;

pub(crate) use components::numbered;
pub use components::{Components, edge_components, label_components};
pub(crate) use dual::{ContractedDual, DualWeights};
pub(crate) use network::{Network, Tree};
pub(crate) use regions::Regions;
pub use sharing::{Coverage, Units, share_out};
pub(crate) use shortest_paths::AllPairs;
