//! Searches on the dual graph: components of faces, shortest paths between them and the
//! shortest tree that joins them.

pub mod components;
pub mod dual;
pub mod network;
mod radix_heap;
pub mod regions;
pub mod shortest_paths;

pub use components::{Components, label_components};
pub use dual::{ContractedDual, DualWeights};
pub use network::{Link, Network, Tree};
pub use regions::{Meeting, Regions};
pub use shortest_paths::AllPairs;
