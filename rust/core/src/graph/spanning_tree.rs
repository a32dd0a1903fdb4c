//! Shortest spanning tree of components over the dual graph, by one search from all of them.

use std::collections::BinaryHeap;

use petgraph::unionfind::UnionFind;

use super::Components;
use super::shortest_paths::{Candidate, DualWeights};
use crate::mesh::{NONE, TriangleMesh};

/// An edge of the rooted tree: two components, the length of the path between them and the
/// half-edge 3 f + k over which the searches from the two met.
#[derive(Debug, Clone, Copy)]
pub struct TreeEdge {
    pub parent: u32,
    pub child: u32,
    pub length: f64,
    meeting: u32,
}

/// One search from all components at once and its buffers.
///
/// Every face belongs to the component that is nearest to it. Two components whose regions touch
/// are joined by the shortest path through that border; the shortest tree over these pairs is the
/// shortest over all pairs (Mehlhorn 1988).
#[derive(Debug, Default)]
pub struct Forest {
    distance: Vec<f64>,
    /// The half-edge over which the face was reached, [`NONE`] in a component.
    entry: Vec<u32>,
    nearest: Vec<u32>,
    heap: BinaryHeap<Candidate>,
    meetings: Vec<TreeEdge>,
    /// The edges of the tree at each component: those of `c` are
    /// `around[starts[c]..starts[c + 1]]`.
    starts: Vec<usize>,
    around: Vec<TreeEdge>,
}

impl Forest {
    /// Searches from the components `sources`; leaves the shortest spanning tree in `tree`, rooted
    /// at the first of them, parents before children.
    pub fn span(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        sources: &[u32],
        tree: &mut Vec<TreeEdge>,
    ) {
        self.search(mesh, weights, components, sources);
        self.meet(mesh, weights);
        self.meetings.sort_unstable_by(|a, b| {
            a.length
                .total_cmp(&b.length)
                .then(a.meeting.cmp(&b.meeting))
        });
        let mut joined = UnionFind::<u32>::new(components.count());
        self.meetings
            .retain(|edge| joined.union(edge.parent, edge.child));
        self.root(sources[0], components.count(), tree);
    }

    /// Turns the edges of the tree away from `root`.
    fn root(&mut self, root: u32, count: usize, tree: &mut Vec<TreeEdge>) {
        self.starts.clear();
        self.starts.resize(count + 1, 0);
        for edge in &self.meetings {
            self.starts[edge.parent as usize] += 1;
            self.starts[edge.child as usize] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.around.clear();
        if let Some(&any) = self.meetings.first() {
            self.around.resize(end, any);
        }
        for &edge in &self.meetings {
            let turned = TreeEdge {
                parent: edge.child,
                child: edge.parent,
                ..edge
            };
            for edge in [edge, turned] {
                let start = &mut self.starts[edge.parent as usize];
                *start -= 1;
                self.around[*start] = edge;
            }
        }
        tree.clear();
        let (mut node, mut from) = (root, NONE);
        let mut head = 0;
        loop {
            let edges = self.starts[node as usize]..self.starts[node as usize + 1];
            tree.extend(self.around[edges].iter().filter(|edge| edge.child != from));
            let Some(next) = tree.get(head) else { break };
            (node, from) = (next.child, next.parent);
            head += 1;
        }
    }

    fn search(
        &mut self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        components: &Components,
        sources: &[u32],
    ) {
        let m = mesh.n_faces();
        self.distance.clear();
        self.distance.resize(m, f64::INFINITY);
        self.entry.clear();
        self.entry.resize(m, NONE);
        self.nearest.clear();
        self.nearest.resize(m, NONE);
        self.heap.clear();
        for &source in sources {
            for &f in components.faces_of(source as usize) {
                self.distance[f as usize] = 0.0;
                self.nearest[f as usize] = source;
            }
        }
        for &source in sources {
            for &f in components.faces_of(source as usize) {
                self.relax(mesh, weights, f as usize);
            }
        }
        while let Some(Candidate { distance, node }) = self.heap.pop() {
            if distance <= self.distance[node as usize] {
                self.relax(mesh, weights, node as usize);
            }
        }
    }

    fn relax(&mut self, mesh: &TriangleMesh, weights: DualWeights, f: usize) {
        for (k, &g) in mesh.neighbours()[f].iter().enumerate() {
            if g == NONE {
                continue;
            }
            let through = self.distance[f]
                + (weights.price[f] + weights.price[g as usize]) * weights.scale[f][k];
            if through < self.distance[g as usize] {
                self.distance[g as usize] = through;
                self.entry[g as usize] = (3 * f + k) as u32;
                self.nearest[g as usize] = self.nearest[f];
                self.heap.push(Candidate {
                    distance: through,
                    node: g,
                });
            }
        }
    }

    /// The shortest meeting of each pair of components whose regions touch.
    fn meet(&mut self, mesh: &TriangleMesh, weights: DualWeights) {
        self.meetings.clear();
        for (f, across) in mesh.neighbours().iter().enumerate() {
            for (k, &g) in across.iter().enumerate() {
                if g == NONE || (g as usize) < f {
                    continue;
                }
                let (a, b) = (self.nearest[f], self.nearest[g as usize]);
                if a == b || a == NONE || b == NONE {
                    continue;
                }
                let step = (weights.price[f] + weights.price[g as usize]) * weights.scale[f][k];
                self.meetings.push(TreeEdge {
                    parent: a.min(b),
                    child: a.max(b),
                    length: self.distance[f] + step + self.distance[g as usize],
                    meeting: (3 * f + k) as u32,
                });
            }
        }
        self.meetings.sort_unstable_by(|a, b| {
            (a.parent, a.child)
                .cmp(&(b.parent, b.child))
                .then(a.length.total_cmp(&b.length))
                .then(a.meeting.cmp(&b.meeting))
        });
        self.meetings.dedup_by_key(|edge| (edge.parent, edge.child));
    }

    /// Derivative of coefficient x length of an edge of the tree: calls `add(f, a)` for every
    /// face f whose price enters with factor a.
    pub fn accumulate_path(
        &self,
        mesh: &TriangleMesh,
        weights: DualWeights,
        edge: &TreeEdge,
        coefficient: f64,
        mut add: impl FnMut(u32, f64),
    ) {
        let mut cross = |half_edge: u32| {
            let (f, k) = ((half_edge / 3) as usize, (half_edge % 3) as usize);
            let factor = coefficient * weights.scale[f][k];
            add(f as u32, factor);
            add(mesh.neighbours()[f][k], factor);
            f
        };
        let f = cross(edge.meeting);
        let g = mesh.neighbours()[f][(edge.meeting % 3) as usize] as usize;
        for start in [f, g] {
            let mut face = start;
            while self.entry[face] != NONE {
                face = cross(self.entry[face]);
            }
        }
    }
}
