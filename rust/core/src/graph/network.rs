//! The graph whose nodes are the components.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::mesh::NONE;

/// A path between two components.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link {
    pub(crate) ends: [u32; 2],
    pub(crate) length: f64,
}

/// Components and the links between them.
#[derive(Debug, Default)]
pub(crate) struct Network {
    /// The links at each node: those of `i` are `around[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    around: Vec<Branch>,
}

/// One side of a link.
#[derive(Debug, Clone, Copy)]
struct Branch {
    length: f64,
    to: u32,
    link: u32,
}

/// A tree in a [`Network`], and the buffers of the search for it.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    /// Nodes, parents before children.
    pub(crate) order: Vec<u32>,
    /// The parent of each node and the link to it, [`NONE`] at the root.
    pub(crate) parents: Vec<u32>,
    pub(crate) links: Vec<u32>,
    /// Of each node from the root, infinite where no link leads to.
    pub(crate) distances: Vec<f64>,
    settled: Vec<bool>,
    heap: BinaryHeap<Candidate>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    distance: f64,
    node: u32,
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

impl Network {
    /// Makes the network of `count` nodes with these links, numbered as they come.
    pub(crate) fn join(&mut self, count: usize, links: impl Iterator<Item = Link> + Clone) {
        self.starts.clear();
        self.starts.resize(count + 1, 0);
        for node in links.clone().flat_map(|link| link.ends) {
            self.starts[node as usize] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        let unset = Branch {
            length: 0.0,
            to: NONE,
            link: NONE,
        };
        self.around.resize(end as usize, unset);
        for (i, Link { ends, length }) in links.enumerate() {
            for [from, to] in [ends, [ends[1], ends[0]]] {
                let start = &mut self.starts[from as usize];
                *start -= 1;
                self.around[*start as usize] = Branch {
                    length,
                    to,
                    link: i as u32,
                };
            }
        }
    }

    /// The shortest paths from `root` (Dijkstra 1959).
    pub(crate) fn shortest_paths(&self, root: u32, tree: &mut Tree) {
        self.search(root, tree, |distance, length| distance + length);
    }

    /// The shortest spanning tree (Prim 1957); its `distances` are those to the parents.
    pub(crate) fn spanning_tree(&self, root: u32, tree: &mut Tree) {
        self.search(root, tree, |_, length| length);
    }

    /// Takes note of a way from the root to `node` that is shorter than known so far: makes the
    /// `distances` of `tree` those that it allows for.
    pub(crate) fn shorten(&self, tree: &mut Tree, node: u32, distance: f64) {
        tree.distances[node as usize] = distance;
        tree.heap.push(Candidate { distance, node });
        while let Some(Candidate { distance, node }) = tree.heap.pop() {
            if distance > tree.distances[node as usize] {
                continue;
            }
            for branch in self.branches(node) {
                let distance = distance + branch.length;
                if distance < tree.distances[branch.to as usize] {
                    tree.distances[branch.to as usize] = distance;
                    tree.heap.push(Candidate {
                        distance,
                        node: branch.to,
                    });
                }
            }
        }
    }

    fn branches(&self, node: u32) -> &[Branch] {
        let i = node as usize;
        &self.around[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    fn search(&self, root: u32, tree: &mut Tree, through: impl Fn(f64, f64) -> f64) {
        let count = self.starts.len() - 1;
        tree.order.clear();
        tree.heap.clear();
        tree.distances.clear();
        tree.distances.resize(count, f64::INFINITY);
        tree.parents.clear();
        tree.parents.resize(count, NONE);
        tree.links.clear();
        tree.links.resize(count, NONE);
        tree.settled.clear();
        tree.settled.resize(count, false);
        tree.distances[root as usize] = 0.0;
        tree.heap.push(Candidate {
            distance: 0.0,
            node: root,
        });
        while let Some(Candidate { distance, node }) = tree.heap.pop() {
            let i = node as usize;
            if tree.settled[i] {
                continue;
            }
            tree.settled[i] = true;
            tree.order.push(node);
            for branch in self.branches(node) {
                let to = branch.to as usize;
                let distance = through(distance, branch.length);
                if !tree.settled[to] && distance < tree.distances[to] {
                    tree.distances[to] = distance;
                    tree.parents[to] = node;
                    tree.links[to] = branch.link;
                    tree.heap.push(Candidate {
                        distance,
                        node: branch.to,
                    });
                }
            }
        }
    }
}
