//! Shortest paths between all components.

use rayon::prelude::*;

use super::dual::{ContractedDual, DualWeights, Step};
use super::network::{Link, Network, Tree};
use super::radix_heap::RadixHeap;
use super::regions::Regions;
use crate::mesh::{NONE, TriangleMesh};
use crate::parallel::Buffers;

/// A way round has to be shorter by this fraction: otherwise rounding could give up both of two
/// ways of the same length.
const MARGIN: f64 = 1e-12;
/// Parts of the sums over all pairs, which are added in order.
const BLOCKS: usize = 16;

/// The shortest paths between all pairs of components.
///
/// A path that touches no third component is *direct*. Shortest paths are chains of direct ones, so
/// that it is enough to find those and then to search the [`Network`] that they make. The search
/// from component i gives up a face f that it reaches at distance D where there is a way round
/// through the component k that is nearest to f: where B_ik + distance(k, f) < D, with B_ik the
/// length of some path from i to k. Nothing is lost: a shortest path from i through f to j is then
/// no shorter than the two from i to k and from k to j, both of which are shorter than it is, so
/// that by induction over the length the chains of direct paths that are found reach from i to j.
///
/// The bounds B are distances in the network of the components whose [`Regions`] touch, together
/// with the direct paths that the same search has found so far. Within its own region the distances
/// from a component are known, so the search starts at the boundary of that.
#[derive(Debug, Default)]
pub(crate) struct AllPairs {
    /// First of the regions that touch, then of the direct paths.
    network: Network,
    /// The half-edges that lead out of a region, each after the component of the region.
    boundaries: Vec<(u32, u32)>,
    direct: Vec<DirectPaths>,
    searches: Buffers<Search>,
    blocks: Vec<Block>,
    /// Derivative by the length of each direct path.
    coefficients: Vec<f64>,
}

/// The direct paths from one component to those after it.
#[derive(Debug, Default)]
struct DirectPaths {
    links: Vec<Link>,
    /// The half-edges of the paths one after the other, and the end of each.
    half_edges: Vec<u32>,
    ends: Vec<usize>,
}

/// The sums over the pairs of some sources.
#[derive(Debug, Default)]
struct Block {
    tree: Tree,
    flow: Vec<f64>,
    coefficients: Vec<f64>,
}

impl AllPairs {
    /// Finds the direct paths.
    pub(crate) fn search(&mut self, graph: &ContractedDual, regions: &Regions) {
        let count = graph.n_nodes() - graph.n_faces();
        if self.direct.len() < count {
            self.direct.resize_with(count, DirectPaths::default);
        }
        self.direct.iter_mut().for_each(DirectPaths::clear);
        let touching = regions.meetings.iter().map(|meeting| meeting.link);
        self.network.join(count, touching);
        self.boundaries.clear();
        regions.crossings(graph, |crossing| {
            let [here, _] = crossing.link.ends;
            self.boundaries.push((here, crossing.half_edge));
        });
        self.boundaries.sort_unstable();
        let (network, boundaries, searches) = (&self.network, &self.boundaries, &self.searches);
        self.direct[..count]
            .par_iter_mut()
            .enumerate()
            .with_max_len(1)
            .for_each(|(source, paths)| {
                let source = source as u32;
                let start = boundaries.partition_point(|side| side.0 < source);
                let end = boundaries.partition_point(|side| side.0 <= source);
                let mut search = searches.take().unwrap_or_default();
                search.run(
                    graph,
                    regions,
                    network,
                    &boundaries[start..end],
                    source,
                    paths,
                );
                searches.give_back(search);
            });
        self.network.join(count, links(&self.direct));
    }

    /// Derivatives of the sum over ordered pairs i != j of w_i w_j d_ij: leaves those by `weights`
    /// in `rows`, which makes the sum half of weights . rows, and keeps those by the lengths of
    /// the direct paths for [`Self::accumulate_paths`].
    pub(crate) fn differentiate(&mut self, weights: &[f64], rows: &mut [f64]) {
        let n_links = links(&self.direct).count();
        let size = weights.len().div_ceil(BLOCKS);
        self.blocks.resize_with(BLOCKS, Block::default);
        let network = &self.network;
        self.blocks
            .par_iter_mut()
            .zip(rows.par_chunks_mut(size))
            .enumerate()
            .for_each(|(block, (part, rows))| {
                part.coefficients.clear();
                part.coefficients.resize(n_links, 0.0);
                for (offset, row) in rows.iter_mut().enumerate() {
                    *row = part.add_source(network, weights, block * size + offset);
                }
            });
        self.coefficients.clear();
        self.coefficients.resize(n_links, 0.0);
        for part in &self.blocks[..weights.len().div_ceil(size)] {
            for (sum, x) in self.coefficients.iter_mut().zip(&part.coefficients) {
                *sum += x;
            }
        }
    }

    /// Derivative of the same sum by the prices: calls `add(f, a)` for every face f whose price
    /// enters with factor a.
    pub(crate) fn accumulate_paths(
        &self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        mut add: impl FnMut(u32, f64),
    ) {
        let mut coefficients = self.coefficients.iter();
        for paths in &self.direct {
            let mut start = 0;
            for (&end, &coefficient) in paths.ends.iter().zip(&mut coefficients) {
                if coefficient != 0.0 {
                    for &half_edge in &paths.half_edges[start..end] {
                        weights.differentiate(mesh, half_edge, coefficient, &mut add);
                    }
                }
                start = end;
            }
        }
    }
}

fn links(direct: &[DirectPaths]) -> impl Iterator<Item = Link> + Clone {
    direct.iter().flat_map(|paths| paths.links.iter().copied())
}

impl DirectPaths {
    fn clear(&mut self) {
        self.links.clear();
        self.half_edges.clear();
        self.ends.clear();
    }
}

impl Block {
    /// Adds the derivative by the direct paths of the pairs of `source` with those after it;
    /// returns the derivative of all its pairs by its weight.
    fn add_source(&mut self, network: &Network, weights: &[f64], source: usize) -> f64 {
        network.shortest_paths(source as u32, &mut self.tree);
        self.flow.clear();
        self.flow.resize(weights.len(), 0.0);
        let mut row = 0.0;
        for (j, (&weight, &distance)) in weights.iter().zip(&self.tree.distances).enumerate() {
            if j != source {
                row += 2.0 * weight * distance;
            }
            if j > source {
                self.flow[j] = 2.0 * weights[source] * weight;
            }
        }
        for &node in self.tree.order[1..].iter().rev() {
            let flow = self.flow[node as usize];
            self.flow[self.tree.parents[node as usize] as usize] += flow;
            self.coefficients[self.tree.links[node as usize] as usize] += flow;
        }
        row
    }
}

#[derive(Debug, Clone, Copy)]
struct Label {
    distance: f64,
    /// The half-edge over which the node was reached.
    entry: u32,
}

const UNREACHED: Label = Label {
    distance: f64::INFINITY,
    entry: NONE,
};

/// The buffers of one search; reused from one search to the next.
#[derive(Debug, Default)]
struct Search {
    /// All unreached between two searches.
    labels: Vec<Label>,
    reached: Vec<u32>,
    heap: RadixHeap,
    /// Shortest known paths from the source to all components.
    bounds: Tree,
}

impl Search {
    /// Finds the direct paths from component `source`, but for those to components before it, which
    /// are found from there.
    fn run(
        &mut self,
        graph: &ContractedDual,
        regions: &Regions,
        network: &Network,
        boundary: &[(u32, u32)],
        source: u32,
        found: &mut DirectPaths,
    ) {
        let m = graph.n_faces();
        if self.labels.len() < graph.n_nodes() {
            self.labels.resize(graph.n_nodes(), UNREACHED);
        }
        network.shortest_paths(source, &mut self.bounds);
        self.heap.clear();
        for &(_, half_edge) in boundary {
            let distance = regions.places[half_edge as usize / 3].distance;
            self.reach(regions, source, half_edge, graph.step(half_edge), distance);
        }
        while let Some((distance, node)) = self.heap.pop() {
            if distance > self.labels[node as usize].distance {
                continue;
            }
            if node as usize >= m {
                let component = node - m as u32;
                if distance < self.bounds.distances[component as usize] {
                    network.shorten(&mut self.bounds, component, distance);
                }
            } else {
                for (half_edge, step) in graph.steps(node as usize) {
                    self.reach(regions, source, half_edge, step, distance);
                }
            }
        }
        for &node in &self.reached {
            if node > m as u32 + source {
                let label = self.labels[node as usize];
                found.links.push(Link {
                    ends: [source, node - m as u32],
                    length: label.distance,
                });
                let mut entry = label.entry;
                while entry != NONE {
                    found.half_edges.push(entry);
                    let (face, place) = (entry as usize / 3, regions.places[entry as usize / 3]);
                    entry = if place.nearest == source {
                        place.entry
                    } else {
                        self.labels[face].entry
                    };
                }
                found.ends.push(found.half_edges.len());
            }
        }
        for node in self.reached.drain(..) {
            self.labels[node as usize] = UNREACHED;
        }
    }

    /// Takes a step from a face that is reached at `distance`.
    #[inline]
    fn reach(&mut self, regions: &Regions, source: u32, half_edge: u32, step: Step, distance: f64) {
        let through = distance + step.length;
        let label = &mut self.labels[step.node as usize];
        if through >= label.distance {
            return;
        }
        let place = regions.places[step.node as usize];
        let round = self.bounds.distances[place.nearest as usize] + place.distance;
        if place.nearest == source || round < through * (1.0 - MARGIN) {
            return;
        }
        if label.entry == NONE {
            self.reached.push(step.node);
        }
        *label = Label {
            distance: through,
            entry: half_edge,
        };
        self.heap.push(through, step.node);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::graph::Components;
    use crate::testing::{grid, noise, torus};

    /// Distances of all faces from a component, without any contraction or bound.
    fn plain_distances(
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        source: usize,
    ) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; mesh.n_faces()];
        let mut queue = VecDeque::new();
        for &f in components.faces_of(source) {
            distances[f as usize] = 0.0;
            queue.push_back(f as usize);
        }
        while let Some(f) = queue.pop_front() {
            for (k, &g) in mesh.neighbours()[f].iter().enumerate() {
                if g == NONE {
                    continue;
                }
                let g = g as usize;
                let length = (weights.price[f] + weights.price[g]) * weights.scale[f][k];
                if distances[f] + length < distances[g] {
                    distances[g] = distances[f] + length;
                    queue.push_back(g);
                }
            }
        }
        distances
    }

    /// Compares with plain searches where the components are a `part` of the faces; returns the
    /// number of components.
    fn check(mesh: &TriangleMesh, part: f64, price: impl Fn(f64) -> f64) -> usize {
        let m = mesh.n_faces();
        let noise = noise(2 * m);
        let inside = |f: usize| noise[f].abs() < part;
        let mut components = Components::default();
        components.label(mesh, inside, |_, _| true);
        // Faces that are free, but no target.
        components.retain(|c| c % 5 != 4);
        let count = components.count();
        let prices: Vec<f64> = (0..m)
            .map(|f| if inside(f) { 0.0 } else { price(noise[m + f]) })
            .collect();
        let scale: Vec<[f64; 3]> = mesh
            .neighbours()
            .iter()
            .enumerate()
            .map(|(f, across)| across.map(|g| 1.0 + ((f + g as usize) % 3) as f64))
            .collect();
        let weights = DualWeights {
            price: &prices,
            scale: &scale,
        };
        let (mut graph, mut regions) = (ContractedDual::default(), Regions::default());
        graph.contract(mesh, weights, &components);
        regions.grow(&graph, &components);
        let mut pairs = AllPairs::default();
        // What an earlier search has left must not matter.
        for _ in 0..2 {
            pairs.search(&graph, &regions);
        }

        let masses: Vec<f64> = (0..count).map(|c| 1.0 + (c % 7) as f64).collect();
        let mut tree = Tree::default();
        let mut expected = 0.0;
        for source in 0..count {
            let plain = plain_distances(mesh, weights, &components, source);
            pairs.network.shortest_paths(source as u32, &mut tree);
            for (target, &distance) in tree.distances.iter().enumerate() {
                let plain = plain[components.faces_of(target)[0] as usize];
                assert!(
                    (distance - plain).abs() <= 1e-12 * plain,
                    "{distance} for {plain} from {source} to {target} of {count}"
                );
                expected += masses[source] * masses[target] * plain;
            }
        }
        let mut rows = vec![0.0; count];
        pairs.differentiate(&masses, &mut rows);
        let value: f64 = masses.iter().zip(&rows).map(|(w, row)| 0.5 * w * row).sum();
        assert!((value - expected).abs() <= 1e-12 * expected);
        // The sum is linear in the prices, so prices . derivative = value (Euler).
        let mut total = 0.0;
        pairs.accumulate_paths(mesh, weights, |f, a| total += a * prices[f as usize]);
        assert!((total - expected).abs() <= 1e-12 * expected);
        count
    }

    #[test]
    fn all_pairs_of_few_and_of_many_components() {
        let sheet = grid(36, 24, |x, y| 0.1 * (6.0 * x).sin() * y);
        let ring = torus(40, 20, 0.4);
        for mesh in [&sheet, &ring] {
            let counts = [0.002, 0.02, 0.1, 0.3].map(|part| {
                // Of a like size, of every size, and with ties everywhere.
                check(mesh, part, |x| 0.1 + x.abs());
                check(mesh, part, |x| (12.0 * x).exp());
                check(mesh, part, |_| 1.0)
            });
            assert!(counts[0] < 6 && counts[3] > 150, "{counts:?}");
        }
    }
}
