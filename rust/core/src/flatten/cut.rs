//! A short cut that opens a surface of any genus, with any boundary, to a disk.

use std::collections::BinaryHeap;

use petgraph::unionfind::UnionFind;

use crate::mesh::{FORBIDDEN, NONE, TriangleMesh, distance};

/// Edges to cut along and their length.
pub(super) struct Cut {
    pub edges: Vec<bool>,
    pub length: f64,
}

/// Cuts along shortest paths: a tree-cotree decomposition (Eppstein 2003) after Erickson and
/// Whittlesey (2005), with the boundary loops contracted.
///
/// The shortest-path tree grows from one boundary loop (from a vertex if there is none) and may
/// run along every boundary for free. The dual spanning tree joins the faces across the edges
/// outside the tree, those that close the longest loops first. What neither tree uses, 2 genus
/// edges, is cut together with the paths that lead to it and to the other boundary loops.
pub(super) fn cut_to_disk(mesh: &TriangleMesh) -> Cut {
    let edges = mesh.edges();
    let half_edges = mesh.edge_half_edges();
    let length = |e: usize| {
        let [a, b] = edges[e].map(|v| mesh.vertices()[v as usize]);
        distance(a, b)
    };
    // An infinite cost would make ways along it alike.
    let cost = |e: usize| length(e) * mesh.seam_cost(e).min(FORBIDDEN);
    let boundary = |e: usize| half_edges[e][1] == NONE;
    let tree = shortest_path_tree(mesh, &cost, &boundary);

    let loop_length = |e: usize| {
        let [a, b] = edges[e];
        tree.distance[a as usize] + tree.distance[b as usize] + cost(e)
    };
    let mut dual_edges: Vec<usize> = (0..edges.len())
        .filter(|&e| !boundary(e) && !tree.edges[e])
        .collect();
    dual_edges.sort_by(|&e, &f| loop_length(f).total_cmp(&loop_length(e)).then(e.cmp(&f)));
    let mut faces = UnionFind::<u32>::new(mesh.n_faces());
    let mut cut: Vec<bool> = (0..edges.len()).map(|e| !boundary(e)).collect();
    for e in dual_edges {
        if faces.union(half_edges[e][0] / 3, half_edges[e][1] / 3) {
            cut[e] = false;
        }
    }
    prune(mesh, &mut cut);
    if mesh.n_boundary_loops() == 0 && !cut.contains(&true) {
        slit(mesh, &tree, &mut cut);
    }
    let length = (0..edges.len()).filter(|&e| cut[e]).map(length).sum();
    Cut { edges: cut, length }
}

struct Tree {
    distance: Vec<f64>,
    edges: Vec<bool>,
    parent_edge: Vec<u32>,
}

impl Tree {
    /// The last edge of the path to a vertex; none at the root.
    fn edge_to(&self, v: usize) -> Option<usize> {
        (self.parent_edge[v] != NONE).then_some(self.parent_edge[v] as usize)
    }
}

fn shortest_path_tree(
    mesh: &TriangleMesh,
    length: &impl Fn(usize) -> f64,
    boundary: &impl Fn(usize) -> bool,
) -> Tree {
    let n = mesh.n_vertices();
    let adjacency = mesh.adjacency();
    let mut tree = Tree {
        distance: vec![f64::INFINITY; n],
        edges: vec![false; mesh.edges().len()],
        parent_edge: vec![NONE; n],
    };
    // Of several paths of one length to a boundary loop one is enough: with all of them in the
    // tree the faces between two would be cut off.
    let mut reached = UnionFind::<u32>::new(n);
    for (e, &[a, b]) in mesh.edges().iter().enumerate() {
        if boundary(e) {
            reached.union(a, b);
        }
    }
    let root = mesh.on_boundary().iter().position(|&b| b).unwrap_or(0);
    let mut settled = vec![false; n];
    // Non-negative floats order as their bits.
    let mut heap = BinaryHeap::new();
    tree.distance[root] = 0.0;
    heap.push(std::cmp::Reverse((0_u64, root as u32)));
    while let Some(std::cmp::Reverse((_, v))) = heap.pop() {
        let v = v as usize;
        if std::mem::replace(&mut settled[v], true) {
            continue;
        }
        if tree.parent_edge[v] != NONE {
            let e = tree.parent_edge[v] as usize;
            let [a, b] = mesh.edges()[e];
            tree.edges[e] = reached.union(a, b);
        }
        for (w, e) in adjacency.around(v) {
            let through = tree.distance[v] + if boundary(e) { 0.0 } else { length(e) };
            if through < tree.distance[w] {
                tree.distance[w] = through;
                tree.parent_edge[w] = e as u32;
                heap.push(std::cmp::Reverse((through.to_bits(), w as u32)));
            }
        }
    }
    tree
}

/// Takes away, again and again, the cut edges that end nowhere; a boundary vertex is no end.
fn prune(mesh: &TriangleMesh, cut: &mut [bool]) {
    let adjacency = mesh.adjacency();
    let mut degree: Vec<u32> = mesh
        .on_boundary()
        .iter()
        .map(|&boundary| if boundary { 2 } else { 0 })
        .collect();
    for (e, &[a, b]) in mesh.edges().iter().enumerate() {
        if cut[e] {
            degree[a as usize] += 1;
            degree[b as usize] += 1;
        }
    }
    let mut ends: Vec<usize> = (0..degree.len()).filter(|&v| degree[v] == 1).collect();
    while let Some(v) = ends.pop() {
        for (w, e) in adjacency.around(v) {
            if cut[e] {
                cut[e] = false;
                degree[v] -= 1;
                degree[w] -= 1;
                if degree[w] == 1 {
                    ends.push(w);
                }
            }
        }
    }
}

/// A sphere has no loop to cut: it is slit along the path to the farthest vertex.
///
/// A slit of one edge would open nothing, as both of its ends stay whole: it goes on to the
/// farthest other neighbour. Three or more edges meet at every vertex of a closed surface.
fn slit(mesh: &TriangleMesh, tree: &Tree, cut: &mut [bool]) {
    let other_end = |e: usize, v: usize| {
        let [a, b] = mesh.edges()[e].map(|w| w as usize);
        if a == v { b } else { a }
    };
    let distance = &tree.distance;
    let mut v = (1..distance.len()).fold(0, |v, w| if distance[w] > distance[v] { w } else { v });
    let root = tree.edge_to(v).map(|e| other_end(e, v));
    if root.is_some_and(|root| tree.edge_to(root).is_none()) {
        let beyond = mesh
            .adjacency()
            .around(v)
            .map(|(_, e)| e)
            .filter(|&e| Some(other_end(e, v)) != root)
            .max_by(|&e, &f| distance[other_end(e, v)].total_cmp(&distance[other_end(f, v)]));
        if let Some(e) = beyond {
            cut[e] = true;
        }
    }
    while let Some(e) = tree.edge_to(v) {
        cut[e] = true;
        v = other_end(e, v);
    }
}
