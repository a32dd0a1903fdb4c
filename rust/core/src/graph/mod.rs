//! Searches on the dual graph: components of faces, shortest paths between them and the
//! shortest tree that joins them.

pub mod components;
pub mod shortest_paths;
pub mod spanning_tree;

pub use components::{Components, label_components};
pub use shortest_paths::{DualWeights, Search};
pub use spanning_tree::{Forest, TreeEdge};
