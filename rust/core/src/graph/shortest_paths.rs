//! Dijkstra's search on the dual graph with every component contracted to one node.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::Components;
use crate::mesh::{NONE, TriangleMesh};

/// Prices of the dual edges: crossing from face f over its half-edge k to g costs
/// (price_f + price_g) scale\[f\]\[k\].
#[derive(Debug, Clone, Copy)]
pub struct DualWeights<'a> {
    pub price: &'a [f64],
    pub scale: &'a [[f64; 3]],
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub(super) distance: f64,
    pub(super) node: u32,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    // Reversed, for a min-heap; ties by node, so that the order never depends on the heap.
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .distance
            .total_cmp(&self.distance)
            .then_with(|| other.node.cmp(&self.node))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The buffers of one search; reused from one search to the next.
///
/// Nodes `0..m` are faces, nodes `m..m + k` the components. A face of a component is never a
/// node of its own.
#[derive(Debug, Default)]
pub struct Search {
    distance: Vec<f64>,
    /// The half-edge over which the node was reached, [`NONE`] at the source.
    entry: Vec<u32>,
    settled: Vec<bool>,
    order: Vec<u32>,
    flow: Vec<f64>,
    heap: BinaryHeap<Candidate>,
}

impl Search {
    /// Searches from component `source` until every component of `targets` is settled.
    pub fn run(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        source: u32,
        targets: &[u32],
    ) {
        let m = mesh.n_faces();
        let n_nodes = m + components.count();
        self.distance.clear();
        self.distance.resize(n_nodes, f64::INFINITY);
        self.entry.clear();
        self.entry.resize(n_nodes, NONE);
        self.settled.clear();
        self.settled.resize(n_nodes, false);
        self.order.clear();
        self.heap.clear();

        let source = m as u32 + source;
        self.distance[source as usize] = 0.0;
        self.heap.push(Candidate {
            distance: 0.0,
            node: source,
        });
        let mut remaining = targets.len();
        while let Some(Candidate { distance, node }) = self.heap.pop() {
            if self.settled[node as usize] {
                continue;
            }
            self.settled[node as usize] = true;
            self.order.push(node);
            if node as usize >= m {
                let component = node - m as u32;
                if node != source && targets.binary_search(&component).is_ok() {
                    remaining -= 1;
                    if remaining == 0 {
                        break;
                    }
                }
                for &f in components.faces_of(component as usize) {
                    self.relax(mesh, weights, components, f as usize, distance);
                }
            } else {
                self.relax(mesh, weights, components, node as usize, distance);
            }
        }
    }

    fn relax(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        f: usize,
        distance: f64,
    ) {
        let m = mesh.n_faces() as u32;
        let own = components.labels[f];
        for (k, &g) in mesh.neighbours()[f].iter().enumerate() {
            if g == NONE {
                continue;
            }
            let label = components.labels[g as usize];
            if label != NONE && label == own {
                continue;
            }
            let node = if label == NONE { g } else { m + label };
            let through =
                distance + (weights.price[f] + weights.price[g as usize]) * weights.scale[f][k];
            if through < self.distance[node as usize] {
                self.distance[node as usize] = through;
                self.entry[node as usize] = (3 * f + k) as u32;
                self.heap.push(Candidate {
                    distance: through,
                    node,
                });
            }
        }
    }

    /// Distance from the source to a component, infinite where the search did not get.
    pub fn distance_to(&self, mesh: &TriangleMesh, component: u32) -> f64 {
        self.distance[mesh.n_faces() + component as usize]
    }

    /// Sums the derivative of sum_c coefficient_c distance(c) over the shortest paths: calls
    /// `add(f, a)` for every face f whose price enters with factor a. `coefficients` pairs a
    /// component with its coefficient.
    pub fn accumulate_paths(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        coefficients: &[(u32, f64)],
        mut add: impl FnMut(u32, f64),
    ) {
        let m = mesh.n_faces() as u32;
        self.flow.clear();
        self.flow.resize(self.distance.len(), 0.0);
        for &(component, coefficient) in coefficients {
            self.flow[(m + component) as usize] += coefficient;
        }
        for &node in self.order.iter().rev() {
            let flow = self.flow[node as usize];
            let entry = self.entry[node as usize];
            if flow == 0.0 || entry == NONE {
                continue;
            }
            let (f, k) = ((entry / 3) as usize, (entry % 3) as usize);
            let label = components.labels[f];
            let previous = if label == NONE { f as u32 } else { m + label };
            self.flow[previous as usize] += flow;
            let factor = flow * weights.scale[f][k];
            add(f as u32, factor);
            add(mesh.neighbours()[f][k], factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::grid;

    #[test]
    fn path_derivative_is_the_distance() {
        // The distance is linear in the prices, so price . derivative = distance (Euler).
        let mesh = grid(12, 6, |_, _| 0.0);
        let centre = |f: usize| {
            mesh.faces()[f]
                .iter()
                .map(|&v| mesh.vertices()[v as usize][0])
                .sum::<f64>()
                / 3.0
        };
        let inside = |f: usize| !(0.2..=0.8).contains(&centre(f));
        let mut components = Components::default();
        components.label(&mesh, inside, |_, _| true);
        assert_eq!(components.count(), 2);
        let price: Vec<f64> = (0..mesh.n_faces())
            .map(|f| {
                if inside(f) {
                    0.0
                } else {
                    1.0 + (f as f64).sin().abs()
                }
            })
            .collect();
        let scale = vec![[0.5; 3]; mesh.n_faces()];
        let weights = DualWeights {
            price: &price,
            scale: &scale,
        };
        let mut search = Search::default();
        search.run(&mesh, weights, &components, 0, &[1]);
        let distance = search.distance_to(&mesh, 1);
        assert!(distance.is_finite() && distance > 0.0);
        let mut total = 0.0;
        search.accumulate_paths(&mesh, weights, &components, &[(1, 1.0)], |f, a| {
            total += a * price[f as usize];
        });
        assert!((total - distance).abs() < 1e-12);
    }
}
