//! The dual graph, with every component contracted to one node.

use rayon::prelude::*;

use super::components::Components;
use crate::mesh::{NONE, TriangleMesh};
use crate::parallel::CHUNK;

/// Prices of the dual edges: crossing from face f over its half-edge k to g costs
/// (price_f + price_g) scale\[f\]\[k\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct DualWeights<'a> {
    /// One price a face.
    pub(crate) price: &'a [f64],
    /// One factor a half-edge.
    pub(crate) scale: &'a [[f64; 3]],
}

impl DualWeights<'_> {
    /// Derivative of coefficient x the length of the step across a half-edge: calls `add(f, a)` for
    /// both faces f, whose prices enter with factor a.
    pub(super) fn differentiate(
        &self,
        mesh: &TriangleMesh,
        half_edge: u32,
        coefficient: f64,
        add: &mut impl FnMut(u32, f64),
    ) {
        let (f, k) = ((half_edge / 3) as usize, (half_edge % 3) as usize);
        let factor = coefficient * self.scale[f][k];
        add(f as u32, factor);
        add(mesh.neighbours()[f][k], factor);
    }
}

/// A step across a half-edge, of infinite length where there is none: at the boundary and within
/// a component.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub(super) length: f64,
    pub(super) node: u32,
}

/// The steps out of every face. Nodes `0..m` are faces, nodes `m..m + k` the components; no step
/// leads to a face of a component.
#[derive(Debug, Default)]
pub(crate) struct ContractedDual {
    steps: Vec<[Step; 3]>,
    n_components: usize,
}

impl ContractedDual {
    /// Makes the graph of these components.
    pub(crate) fn contract(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights<'_>,
        components: &Components,
    ) {
        let nowhere = Step {
            length: f64::INFINITY,
            node: 0,
        };
        let m = mesh.n_faces();
        self.n_components = components.count();
        self.steps.resize(m, [nowhere; 3]);
        self.steps
            .par_chunks_mut(CHUNK)
            .enumerate()
            .for_each(|(chunk, steps)| {
                for (offset, steps) in steps.iter_mut().enumerate() {
                    let f = chunk * CHUNK + offset;
                    let own = components.labels[f];
                    for (k, &g) in mesh.neighbours()[f].iter().enumerate() {
                        steps[k] = nowhere;
                        if g == NONE {
                            continue;
                        }
                        let label = components.labels[g as usize];
                        if label == NONE || label != own {
                            let price = weights.price[f] + weights.price[g as usize];
                            steps[k] = Step {
                                length: price * weights.scale[f][k],
                                node: if label == NONE { g } else { m as u32 + label },
                            };
                        }
                    }
                }
            });
    }

    pub(super) fn n_faces(&self) -> usize {
        self.steps.len()
    }

    pub(super) fn n_nodes(&self) -> usize {
        self.steps.len() + self.n_components
    }

    pub(super) fn step(&self, half_edge: u32) -> Step {
        self.steps[half_edge as usize / 3][half_edge as usize % 3]
    }

    /// The steps out of a face, each with its half-edge.
    pub(super) fn steps(&self, f: usize) -> impl Iterator<Item = (u32, Step)> {
        self.steps[f]
            .iter()
            .enumerate()
            .map(move |(k, &step)| ((3 * f + k) as u32, step))
    }
}
