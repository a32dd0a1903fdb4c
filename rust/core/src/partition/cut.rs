//! A short cut that opens a chart to a disk: the one that [`crate::flatten`] makes, with vertices and
//! edges numbered as there, so that equally short cuts are decided alike.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use petgraph::unionfind::UnionFind;

use super::geometry::{Geometry, next};
use super::marks::{Marks, walk_fan};
use crate::mesh::NONE;

pub(super) struct Opening {
    /// Whether a half-edge of the chart is cut; `3 i + k` for face `i` of the chart.
    pub half_edges: Vec<bool>,
    /// In the units of the surface.
    pub length: f64,
}

struct Edge {
    ends: [u32; 2],
    length: f64,
    /// Places `3 i + k` in the chart of its half-edges; [`NONE`] on the boundary.
    sides: [u32; 2],
}

impl Edge {
    fn on_boundary(&self) -> bool {
        self.sides[1] == NONE
    }
}

/// The graph of the vertices of a chart, where a vertex at which the chart touches itself stands
/// once for each of its fans.
struct Network {
    edges: Vec<Edge>,
    /// Edges at each vertex: `incident[starts[v]..starts[v + 1]]`.
    starts: Vec<usize>,
    incident: Vec<u32>,
    on_boundary: Vec<bool>,
    n_loops: usize,
}

/// Cuts along shortest paths: a tree-cotree decomposition (Eppstein 2003) after Erickson and
/// Whittlesey (2005), with the boundary loops contracted.
pub(super) fn cut_to_disk(
    geometry: &Geometry,
    faces: &[u32],
    inner: &[u32],
    marks: &Marks,
) -> Opening {
    let network = Network::new(geometry, faces, inner, marks);
    let edges = &network.edges;
    let tree = Tree::new(&network);
    // Those that close the longest loops first; positive floats order as their bits.
    let mut dual: Vec<(Reverse<u64>, u32)> = (0..edges.len())
        .filter(|&e| !edges[e].on_boundary() && !tree.edges[e])
        .map(|e| {
            let [a, b] = edges[e].ends.map(|v| tree.distance[v as usize]);
            (Reverse((a + b + edges[e].length).to_bits()), e as u32)
        })
        .collect();
    dual.sort_unstable();
    let mut joined = UnionFind::<u32>::new(faces.len());
    let mut cut: Vec<bool> = edges.iter().map(|edge| !edge.on_boundary()).collect();
    for (_, e) in dual {
        let [h, g] = edges[e as usize].sides;
        if joined.union(h / 3, g / 3) {
            cut[e as usize] = false;
        }
    }
    network.prune(&mut cut);
    if network.n_loops == 0 && !cut.contains(&true) {
        tree.slit(&network, &mut cut);
    }
    let mut opening = Opening {
        half_edges: vec![false; 3 * faces.len()],
        length: 0.0,
    };
    for (edge, _) in edges.iter().zip(&cut).filter(|(_, cut)| **cut) {
        opening.length += edge.length;
        for side in edge.sides {
            opening.half_edges[side as usize] = true;
        }
    }
    opening
}

impl Network {
    fn new(geometry: &Geometry, faces: &[u32], inner: &[u32], marks: &Marks) -> Self {
        let place = |h: usize| marks.face(h / 3).map(|i| 3 * i + h % 3);
        let twin = |h: usize| {
            let twin = geometry.twins[h];
            if twin == NONE {
                None
            } else {
                place(twin as usize)
            }
        };
        let half_edges = || {
            faces
                .iter()
                .flat_map(|&f| 3 * f as usize..3 * f as usize + 3)
        };
        let is_boundary = |h: usize| twin(h).is_none();
        // The place of each corner in its fan's loop, then the vertices in the order of first use.
        let mut fan_of = vec![NONE; 3 * faces.len()];
        let (mut n_fans, mut n_loops) = (0, 0);
        let mut fan = Vec::new();
        for (i, first) in half_edges().enumerate() {
            if is_boundary(first) && fan_of[i] == NONE {
                n_loops += 1;
                let mut h = first;
                loop {
                    fan.clear();
                    h = walk_fan(geometry, h, &is_boundary, &mut fan);
                    for i in fan.iter().filter_map(|&at| place(at as usize)) {
                        fan_of[i] = n_fans;
                    }
                    n_fans += 1;
                    if h == first {
                        break;
                    }
                }
            }
        }
        let mut fan_vertex = vec![NONE; n_fans as usize];
        let mut inner_vertex = vec![NONE; inner.len()];
        let mut n = 0_u32;
        let corner: Vec<u32> = half_edges()
            .zip(&fan_of)
            .map(|(h, &fan)| {
                let vertex = match marks.vertex(geometry.origins[h] as usize) {
                    Some(v) => &mut inner_vertex[v],
                    None => &mut fan_vertex[fan as usize],
                };
                if *vertex == NONE {
                    *vertex = n;
                    n += 1;
                }
                *vertex
            })
            .collect();
        let mut edges = Vec::with_capacity(3 * faces.len() / 2 + 8);
        for (i, h) in half_edges().enumerate() {
            let other = twin(h).map_or(NONE, |j| j as u32);
            if other == NONE || (i as u32) < other {
                let (a, b) = (corner[i], corner[next(i)]);
                edges.push(Edge {
                    ends: [a.min(b), a.max(b)],
                    length: geometry.surface_costs[h],
                    sides: [i as u32, other],
                });
            }
        }
        edges.sort_unstable_by_key(|edge| edge.ends);
        let mut starts = vec![0; n as usize + 1];
        let mut on_boundary = vec![false; n as usize];
        for edge in &edges {
            for v in edge.ends {
                starts[v as usize + 1] += 1;
                on_boundary[v as usize] |= edge.on_boundary();
            }
        }
        for v in 0..n as usize {
            starts[v + 1] += starts[v];
        }
        let mut incident = vec![0; starts[n as usize]];
        let mut cursor = starts.clone();
        for (e, edge) in edges.iter().enumerate() {
            for v in edge.ends {
                incident[cursor[v as usize]] = e as u32;
                cursor[v as usize] += 1;
            }
        }
        Self {
            edges,
            starts,
            incident,
            on_boundary,
            n_loops,
        }
    }

    fn at(&self, v: usize) -> &[u32] {
        &self.incident[self.starts[v]..self.starts[v + 1]]
    }

    /// The other end of edge `e`.
    fn across(&self, e: u32, v: usize) -> usize {
        let [a, b] = self.edges[e as usize].ends;
        if a as usize == v {
            b as usize
        } else {
            a as usize
        }
    }

    /// Takes away, again and again, the cut edges that end nowhere; a boundary vertex is no end.
    fn prune(&self, cut: &mut [bool]) {
        let mut degree: Vec<u32> = self.on_boundary.iter().map(|&b| 2 * u32::from(b)).collect();
        for (edge, _) in self.edges.iter().zip(&*cut).filter(|(_, cut)| **cut) {
            for v in edge.ends {
                degree[v as usize] += 1;
            }
        }
        let mut ends: Vec<usize> = (0..degree.len()).filter(|&v| degree[v] == 1).collect();
        while let Some(v) = ends.pop() {
            for &e in self.at(v) {
                if std::mem::take(&mut cut[e as usize]) {
                    degree[v] -= 1;
                    let w = self.across(e, v);
                    degree[w] -= 1;
                    if degree[w] == 1 {
                        ends.push(w);
                    }
                }
            }
        }
    }
}

/// Shortest paths from one boundary loop, or from one vertex, that run along boundaries for free.
struct Tree {
    distance: Vec<f64>,
    edges: Vec<bool>,
    parent_edge: Vec<u32>,
}

impl Tree {
    fn new(network: &Network) -> Self {
        let n = network.on_boundary.len();
        let mut tree = Self {
            distance: vec![f64::INFINITY; n],
            edges: vec![false; network.edges.len()],
            parent_edge: vec![NONE; n],
        };
        // Of several paths of one length to a boundary loop one is enough: with all of them in the
        // tree the faces between two would be cut off.
        let mut reached = UnionFind::<u32>::new(n);
        for edge in network.edges.iter().filter(|edge| edge.on_boundary()) {
            reached.union(edge.ends[0], edge.ends[1]);
        }
        let root = network.on_boundary.iter().position(|&b| b).unwrap_or(0);
        let mut settled = vec![false; n];
        // Non-negative floats order as their bits.
        let mut heap = BinaryHeap::new();
        tree.distance[root] = 0.0;
        heap.push(Reverse((0_u64, root as u32)));
        while let Some(Reverse((_, v))) = heap.pop() {
            let v = v as usize;
            if std::mem::replace(&mut settled[v], true) {
                continue;
            }
            if tree.parent_edge[v] != NONE {
                let e = tree.parent_edge[v] as usize;
                let [a, b] = network.edges[e].ends;
                tree.edges[e] = reached.union(a, b);
            }
            for &e in network.at(v) {
                let edge = &network.edges[e as usize];
                let w = network.across(e, v);
                let step = if edge.on_boundary() { 0.0 } else { edge.length };
                let through = tree.distance[v] + step;
                if through < tree.distance[w] {
                    tree.distance[w] = through;
                    tree.parent_edge[w] = e;
                    heap.push(Reverse((through.to_bits(), w as u32)));
                }
            }
        }
        tree
    }

    /// A sphere has no loop to cut: it is slit along the path to the farthest vertex.
    fn slit(&self, network: &Network, cut: &mut [bool]) {
        let mut v = 0;
        for w in 0..self.distance.len() {
            if self.distance[w] > self.distance[v] {
                v = w;
            }
        }
        while self.parent_edge[v] != NONE {
            let e = self.parent_edge[v];
            cut[e as usize] = true;
            v = network.across(e, v);
        }
    }
}
