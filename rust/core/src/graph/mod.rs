//! Searches on the dual graph: components of faces and shortest paths between them.

pub mod components;
pub mod shortest_paths;

pub use components::{Components, label_components};
pub use shortest_paths::{DualWeights, Search};
