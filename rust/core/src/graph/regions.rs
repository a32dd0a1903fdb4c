//! Regions of the faces that are nearest to each component, by one search from all of them.

use super::components::Components;
use super::dual::{ContractedDual, DualWeights};
use super::network::Link;
use super::radix_heap::RadixHeap;
use crate::mesh::{NONE, TriangleMesh};

/// What the search found out about a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// To the nearest component.
    pub(super) distance: f64,
    pub(super) nearest: u32,
    /// The half-edge over which the node was reached, [`NONE`] in a component.
    pub(super) entry: u32,
}

/// The shortest path between two components whose regions touch, along the two searches that met
/// across a half-edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Meeting {
    pub(crate) link: Link,
    pub(super) half_edge: u32,
}

/// One search from all components at once and its buffers.
///
/// Every node belongs to the component that is nearest to it. Two components whose regions touch
/// are joined by the shortest path through their common boundary; the shortest tree over these pairs is the
/// shortest over all pairs (Mehlhorn 1988).
#[derive(Debug, Default)]
pub(crate) struct Regions {
    pub(super) places: Vec<Place>,
    heap: RadixHeap,
    /// One for each pair of components whose regions touch.
    pub(crate) meetings: Vec<Meeting>,
}

impl Regions {
    /// Searches from all components.
    pub(crate) fn grow(&mut self, graph: &ContractedDual, components: &Components) {
        self.places.clear();
        let unknown = Place {
            distance: f64::INFINITY,
            nearest: NONE,
            entry: NONE,
        };
        self.places.resize(graph.n_nodes(), unknown);
        for c in 0..components.count() {
            let here = Place {
                distance: 0.0,
                nearest: c as u32,
                entry: NONE,
            };
            self.places[graph.n_faces() + c] = here;
            for &f in components.faces_of(c) {
                self.places[f as usize] = here;
            }
        }
        self.heap.clear();
        for &f in &components.faces {
            self.relax(graph, f as usize);
        }
        while let Some((distance, node)) = self.heap.pop() {
            if distance <= self.places[node as usize].distance {
                self.relax(graph, node as usize);
            }
        }
        self.meet(graph);
    }

    fn relax(&mut self, graph: &ContractedDual, f: usize) {
        let Place {
            distance, nearest, ..
        } = self.places[f];
        for (half_edge, step) in graph.steps(f) {
            let through = distance + step.length;
            let place = &mut self.places[step.node as usize];
            if through < place.distance {
                *place = Place {
                    distance: through,
                    nearest,
                    entry: half_edge,
                };
                self.heap.push(through, step.node);
            }
        }
    }

    /// Calls `cross` with every half-edge that leads from a region to another, the components of the
    /// two, the first of them first, and the length of the path that crosses there.
    pub(super) fn crossings(&self, graph: &ContractedDual, mut cross: impl FnMut(Meeting)) {
        for f in 0..graph.n_faces() {
            let here = self.places[f];
            for (half_edge, step) in graph.steps(f) {
                let there = self.places[step.node as usize];
                let length = here.distance + step.length + there.distance;
                if here.nearest != there.nearest && length < f64::INFINITY {
                    cross(Meeting {
                        link: Link {
                            ends: [here.nearest, there.nearest],
                            length,
                        },
                        half_edge,
                    });
                }
            }
        }
    }

    /// The shortest meeting of each pair of components whose regions touch.
    fn meet(&mut self, graph: &ContractedDual) {
        let mut meetings = std::mem::take(&mut self.meetings);
        meetings.clear();
        self.crossings(graph, |meeting| {
            if meeting.link.ends[0] < meeting.link.ends[1] {
                meetings.push(meeting);
            }
        });
        self.meetings = meetings;
        self.meetings.sort_unstable_by(|a, b| {
            (a.link.ends.cmp(&b.link.ends))
                .then(a.link.length.total_cmp(&b.link.length))
                .then(a.half_edge.cmp(&b.half_edge))
        });
        self.meetings.dedup_by_key(|meeting| meeting.link.ends);
    }

    /// Derivative of coefficient x length of a meeting: calls `add(f, a)` for every face f whose
    /// price enters with factor a.
    pub(crate) fn accumulate_path(
        &self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        meeting: &Meeting,
        coefficient: f64,
        mut add: impl FnMut(u32, f64),
    ) {
        let half_edge = meeting.half_edge as usize;
        let across = mesh.neighbours()[half_edge / 3][half_edge % 3] as usize;
        weights.differentiate(mesh, meeting.half_edge, coefficient, &mut add);
        for mut face in [half_edge / 3, across] {
            while self.places[face].entry != NONE {
                let entry = self.places[face].entry;
                weights.differentiate(mesh, entry, coefficient, &mut add);
                face = entry as usize / 3;
            }
        }
    }
}
