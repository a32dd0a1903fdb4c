//! Simplified meshes: edges collapse, the cheapest first, and none that would change the topology.

mod quadric;

use rayon::prelude::*;

use crate::mesh::{NONE, TriangleMesh, cross, dot, subtract};
use quadric::Quadric;

/// Part of the edges, the cheapest, that may collapse before all costs are taken anew.
const CHEAPEST: f64 = 0.2;
/// Least part of the faces that a round removes, else it is the last; and of the edges that are looked
/// at in rounds where the cheapest ones are stuck.
const STUCK: f64 = 0.01;
/// What a collapse may do to the faces around it, and what it may do where nothing else is left.
const STRICT: Limits = Limits {
    turn: 0.3,
    poor: 0.15,
};
const LENIENT: Limits = Limits {
    turn: 0.1,
    poor: 0.01,
};

/// Bounds on the change of a face.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Cosine of the largest angle by which it may turn.
    turn: f64,
    /// Quality, 1 where it is equilateral, below which it may not become worse.
    poor: f64,
}

/// A mesh with fewer faces, and where the vertices have gone.
#[derive(Debug)]
pub struct Simplified {
    /// Positions of its vertices, in the order of those that they are left of.
    pub vertices: Vec<[f64; 3]>,
    /// Its faces, in the order of those that they are left of.
    pub faces: Vec<[u32; 3]>,
    /// The vertex that each vertex of the mesh has collapsed to.
    pub collapsed_to: Vec<u32>,
}

/// Collapses edges until about `n_faces` are left, or more where none can go.
///
/// The result is a manifold of the topology of the mesh: an edge collapses only where the links of its
/// ends meet in the link of the edge alone (Dey, Edelsbrunner, Guha, Nekhayev 1999). No face is turned
/// far. Costs are quadrics weighted by area (Garland and Heckbert 1997), taken in rounds.
#[must_use]
pub fn simplify(mesh: &TriangleMesh, n_faces: usize) -> Simplified {
    // Around a vertex, so that far from the origin no digits are lost.
    let base = mesh.vertices()[0];
    let mut net = Net::new(mesh, base);
    let mut edges: Vec<u32> = mesh
        .edge_half_edges()
        .iter()
        .map(|sides| sides[0])
        .collect();
    let mut part = CHEAPEST;
    while net.n_faces > n_faces {
        let before = net.n_faces;
        edges.retain(|&h| net.is_edge(h as usize));
        let mut candidates: Vec<(u64, u32)> = edges
            .par_iter()
            // Non-negative floats order as their bits.
            .map(|&h| (net.cost(h as usize).to_bits(), h))
            .collect();
        // An inner edge takes two faces with it; about half of the candidates share an end with a
        // cheaper one.
        let wanted = (before - n_faces).max(16);
        let count = ((part * candidates.len() as f64) as usize + 16).min(candidates.len());
        if count < candidates.len() {
            candidates.select_nth_unstable(count);
            candidates.truncate(count);
        }
        candidates.par_sort_unstable();
        let dearest = candidates
            .last()
            .map_or(0.0, |&(bits, _)| f64::from_bits(bits));
        let limits = if part < 1.0 { STRICT } else { LENIENT };
        let mut touched = vec![false; net.positions.len()];
        for (_, h) in candidates {
            if before - net.n_faces >= wanted {
                break;
            }
            net.collapse(h as usize, dearest, limits, &mut touched);
        }
        let removed = before - net.n_faces;
        if removed < (STUCK * before as f64) as usize + 1 && net.n_faces > n_faces {
            if part >= 1.0 {
                break;
            }
            part = (4.0 * part).min(1.0);
        } else {
            part = CHEAPEST;
        }
    }
    net.finish(base)
}

/// A mesh by half-edges that can lose some: half-edge `3 f + k` runs from corner `k` of face `f` on.
struct Net {
    origins: Vec<u32>,
    /// The half-edge on the other side; [`NONE`] at the border.
    twins: Vec<u32>,
    /// A half-edge that starts at each vertex, at the border the first one counterclockwise; [`NONE`]
    /// for one that is gone.
    starts: Vec<u32>,
    positions: Vec<[f64; 3]>,
    quadrics: Vec<Quadric>,
    on_border: Vec<bool>,
    /// The vertex that each has collapsed to, itself for one that is left.
    target: Vec<u32>,
    gone: Vec<bool>,
    n_faces: usize,
}

fn next(h: usize) -> usize {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

fn previous(h: usize) -> usize {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

impl Net {
    fn new(mesh: &TriangleMesh, base: [f64; 3]) -> Self {
        let (n, m) = (mesh.n_vertices(), mesh.n_faces());
        let origins: Vec<u32> = mesh.faces().as_flattened().to_vec();
        let mut twins = vec![NONE; 3 * m];
        for &[a, b] in mesh.edge_half_edges() {
            if b != NONE {
                twins[a as usize] = b;
                twins[b as usize] = a;
            }
        }
        let mut starts = vec![NONE; n];
        for (h, &v) in (0..).zip(&origins) {
            // The first half-edge counterclockwise has no face to its right.
            if starts[v as usize] == NONE || twins[h as usize] == NONE {
                starts[v as usize] = h;
            }
        }
        let positions: Vec<[f64; 3]> = mesh.vertices().iter().map(|&p| subtract(p, base)).collect();
        let mut quadrics = vec![Quadric::default(); n];
        for (f, face) in mesh.faces().iter().enumerate() {
            let corners = face.map(|v| positions[v as usize]);
            for k in 0..3 {
                quadrics[face[k] as usize] += Quadric::corner(corners, corners[k]);
                if twins[3 * f + k] == NONE {
                    let [a, b, c] = [0, 1, 2].map(|j| corners[(k + j) % 3]);
                    let border = Quadric::border(a, b, c);
                    quadrics[face[k] as usize] += border;
                    quadrics[face[(k + 1) % 3] as usize] += border;
                }
            }
        }
        Self {
            origins,
            twins,
            starts,
            positions,
            quadrics,
            on_border: mesh.on_boundary().to_vec(),
            target: (0..n as u32).collect(),
            gone: vec![false; m],
            n_faces: m,
        }
    }

    /// Whether a half-edge is left, and the one of the two that stands for the edge.
    fn is_edge(&self, h: usize) -> bool {
        !self.gone[h / 3] && (self.twins[h] == NONE || h < self.twins[h] as usize)
    }

    fn ends(&self, h: usize) -> [usize; 2] {
        [h, next(h)].map(|h| self.origins[h] as usize)
    }

    fn cost(&self, h: usize) -> f64 {
        let [v, w] = self.ends(h);
        let (_, value) = (self.quadrics[v] + self.quadrics[w]).least();
        if value.is_nan() { f64::INFINITY } else { value }
    }

    /// The half-edges that start at a vertex, counterclockwise, at the border from the first one on.
    fn fan(&self, v: usize) -> impl Iterator<Item = usize> {
        let start = self.starts[v];
        let mut h = start;
        std::iter::from_fn(move || {
            if h == NONE {
                return None;
            }
            let found = h as usize;
            h = self.twins[previous(found)];
            if h == start {
                h = NONE;
            }
            Some(found)
        })
    }

    /// The vertices around a vertex.
    fn around(&self, v: usize, ring: &mut Vec<u32>) {
        ring.clear();
        for h in self.fan(v) {
            ring.push(self.origins[next(h)]);
            if self.twins[previous(h)] == NONE {
                ring.push(self.origins[previous(h)]);
            }
        }
    }

    /// Whether the ends may become one: their links meet in the link of the edge alone. A border counts
    /// as a face whose third corner is one more vertex.
    fn keeps_topology(&self, h: usize) -> bool {
        let [v, w] = self.ends(h);
        let twin = self.twins[h];
        if self.on_border[v] && self.on_border[w] && twin != NONE {
            return false;
        }
        let sides = [Some(h), (twin != NONE).then_some(twin as usize)];
        let mut opposite = [NONE; 2];
        for (side, third) in sides.into_iter().zip(&mut opposite) {
            let Some(side) = side else { continue };
            let (a, b) = (self.twins[next(side)], self.twins[previous(side)]);
            *third = self.origins[previous(side)];
            // A vertex must not be left with less than three faces around it, or at the border one.
            if a == NONE && b == NONE {
                return false;
            }
            if !self.on_border[*third as usize] && self.fan(*third as usize).count() <= 3 {
                return false;
            }
        }
        let (mut first, mut second) = (Vec::with_capacity(12), Vec::with_capacity(12));
        self.around(v, &mut first);
        self.around(w, &mut second);
        first
            .iter()
            .all(|x| opposite.contains(x) || !second.contains(x))
    }

    /// Whether no face around the ends of an edge is turned far or made thin when they move to `point`.
    fn keeps_shape(&self, h: usize, point: [f64; 3], limits: Limits) -> bool {
        let [v, w] = self.ends(h);
        [(v, w), (w, v)].into_iter().all(|(end, other)| {
            self.fan(end).all(|h| {
                let (a, b) = (
                    self.origins[next(h)] as usize,
                    self.origins[previous(h)] as usize,
                );
                if a == other || b == other {
                    return true;
                }
                let (a, b) = (self.positions[a], self.positions[b]);
                let (old, before) = shape(self.positions[end], a, b);
                let (new, after) = shape(point, a, b);
                let turned = dot(old, new) < limits.turn * (dot(old, old) * dot(new, new)).sqrt();
                !turned && (after >= limits.poor || after >= before) && after > 0.0
            })
        })
    }

    /// Where the ends of an edge may go: the cheapest point, else the middle or an end if that costs no
    /// more than `dearest`.
    fn place(&self, h: usize, quadric: &Quadric, dearest: f64, limits: Limits) -> Option<[f64; 3]> {
        let [p, q] = self.ends(h).map(|v| self.positions[v]);
        let (least, value) = quadric.least();
        if value.is_finite() && self.keeps_shape(h, least, limits) {
            return Some(least);
        }
        let middle = [0, 1, 2].map(|axis| 0.5 * (p[axis] + q[axis]));
        [middle, p, q]
            .into_iter()
            .find(|&point| quadric.value(point) <= dearest && self.keeps_shape(h, point, limits))
    }

    /// Collapses an edge if both ends are untouched and it may go.
    fn collapse(&mut self, h: usize, dearest: f64, limits: Limits, touched: &mut [bool]) {
        if self.gone[h / 3] {
            return;
        }
        let [v, w] = self.ends(h);
        if touched[v] || touched[w] || !self.keeps_topology(h) {
            return;
        }
        let quadric = self.quadrics[v] + self.quadrics[w];
        let Some(point) = self.place(h, &quadric, dearest, limits) else {
            return;
        };
        let twin = self.twins[h];
        let leaving: Vec<usize> = self.fan(v).chain(self.fan(w)).collect();
        let mut dead = vec![h / 3];
        if twin != NONE {
            dead.push(twin as usize / 3);
        }
        let sides = [Some(h), (twin != NONE).then_some(twin as usize)];
        let mut thirds = [NONE; 2];
        for (side, third) in sides.into_iter().zip(&mut thirds) {
            let Some(side) = side else { continue };
            *third = self.origins[previous(side)];
            let (a, b) = (self.twins[next(side)], self.twins[previous(side)]);
            if a != NONE {
                self.twins[a as usize] = b;
            }
            if b != NONE {
                self.twins[b as usize] = a;
            }
        }
        for &f in &dead {
            self.gone[f] = true;
        }
        self.n_faces -= dead.len();
        // The lower of both stays.
        let (kept, lost) = (v.min(w), v.max(w));
        let mut start = NONE;
        for &leaving in &leaving {
            if self.gone[leaving / 3] {
                continue;
            }
            self.origins[leaving] = kept as u32;
            if start == NONE || self.twins[leaving] == NONE {
                start = leaving as u32;
            }
        }
        self.starts[kept] = start;
        self.starts[lost] = NONE;
        self.target[lost] = kept as u32;
        self.positions[kept] = point;
        self.quadrics[kept] = quadric;
        self.on_border[kept] |= self.on_border[lost];
        // A third corner may have started in a face that is gone.
        for third in thirds {
            if third != NONE {
                self.restart(third as usize, &leaving);
            }
        }
        touched[kept] = true;
    }

    /// Finds the first half-edge of a vertex in the faces around a collapsed one.
    fn restart(&mut self, third: usize, leaving: &[usize]) {
        let start = self.starts[third];
        if !self.gone[start as usize / 3] && self.twins[start as usize] == NONE {
            return;
        }
        let mut found = if self.gone[start as usize / 3] {
            NONE
        } else {
            start
        };
        for &h in leaving {
            if self.gone[h / 3] {
                continue;
            }
            for g in [next(h), previous(h)] {
                if self.origins[g] as usize == third && (found == NONE || self.twins[g] == NONE) {
                    found = g as u32;
                }
            }
        }
        self.starts[third] = found;
    }

    fn finish(self, base: [f64; 3]) -> Simplified {
        let mut numbers = vec![NONE; self.starts.len()];
        let mut vertices = Vec::new();
        let mut collapsed_to: Vec<u32> = Vec::with_capacity(numbers.len());
        for (v, &start) in self.starts.iter().enumerate() {
            if start == NONE {
                // What a vertex collapses to has a lower number.
                collapsed_to.push(collapsed_to[self.target[v] as usize]);
            } else {
                numbers[v] = vertices.len() as u32;
                collapsed_to.push(numbers[v]);
                vertices.push([0, 1, 2].map(|axis| self.positions[v][axis] + base[axis]));
            }
        }
        let faces = self.origins.as_chunks::<3>().0.iter().zip(&self.gone);
        Simplified {
            vertices,
            faces: faces
                .filter(|(_, gone)| !**gone)
                .map(|(face, _)| face.map(|v| numbers[v as usize]))
                .collect(),
            collapsed_to,
        }
    }
}

/// Normal, twice as long as the area, and quality of a face: 1 where it is equilateral.
fn shape(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> ([f64; 3], f64) {
    let sides = [subtract(a, p), subtract(b, a), subtract(p, b)];
    let normal = cross(sides[0], sides[1]);
    let squares: f64 = sides.iter().map(|&side| dot(side, side)).sum();
    (
        normal,
        2.0 * 3.0_f64.sqrt() * dot(normal, normal).sqrt() / squares,
    )
}

/// The face of a simplified mesh for each face of the mesh that it was made of: that of nearest centroid
/// and unit normal among those at the vertices that its corners have collapsed to. `normals` is the
/// weight of the normals against the centroids in roots of the area.
#[must_use]
pub fn parents(
    mesh: &TriangleMesh,
    simplified: &TriangleMesh,
    collapsed_to: &[u32],
    normals: f64,
) -> Vec<u32> {
    let faces = simplified.faces();
    let mut starts = vec![0_usize; simplified.n_vertices() + 1];
    for &v in faces.as_flattened() {
        starts[v as usize + 1] += 1;
    }
    for v in 1..starts.len() {
        starts[v] += starts[v - 1];
    }
    let mut cursor = starts.clone();
    let mut at = vec![0_u32; 3 * faces.len()];
    for (f, face) in (0..).zip(faces) {
        for &v in face {
            at[cursor[v as usize]] = f;
            cursor[v as usize] += 1;
        }
    }
    let weight = normals * normals * mesh.area();
    let place = |mesh: &TriangleMesh, f: usize| {
        let [a, b, c] = mesh.faces()[f].map(|v| mesh.vertices()[v as usize]);
        let normal = cross(subtract(b, a), subtract(c, a));
        let length = dot(normal, normal).sqrt();
        (
            [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0),
            normal.map(|x| x / (length + f64::MIN_POSITIVE)),
        )
    };
    let places: Vec<([f64; 3], [f64; 3])> =
        (0..faces.len()).map(|f| place(simplified, f)).collect();
    mesh.faces()
        .par_iter()
        .enumerate()
        .map(|(f, face)| {
            let (centroid, normal) = place(mesh, f);
            let mut best = (f64::INFINITY, 0);
            for v in face {
                let v = collapsed_to[*v as usize] as usize;
                for &g in &at[starts[v]..starts[v + 1]] {
                    let (other, other_normal) = places[g as usize];
                    let (d, e) = (subtract(centroid, other), subtract(normal, other_normal));
                    let distance = dot(d, d) + weight * dot(e, e);
                    if distance < best.0 || (distance <= best.0 && g < best.1) {
                        best = (distance, g);
                    }
                }
            }
            best.1
        })
        .collect()
}
