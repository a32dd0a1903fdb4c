//! The surfaces that the benchmarks work on, and epsilon, the same at every run.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

use phaseatlas_core::{Surface, TriangleMesh};

/// Subdivisions of the icosahedron: 10,242, 40,962 and 163,842 vertices.
const SUBDIVISIONS: [u32; 3] = [5, 6, 7];
/// Random displacement of the irregular mesh's vertices, relative to the edge length.
const JITTER: f64 = 0.25;
/// A flip is taken where its two triangles are at least this good, 1 for equilateral ones.
const FLIP_QUALITY: f64 = 0.5;

/// One surface of unit area.
pub struct Case {
    /// Name and number of vertices, as criterion prints them.
    pub label: String,
    pub surface: Arc<Surface>,
    /// Twice the mean edge length.
    pub epsilon: f64,
}

/// An icosphere and an irregular mesh of every size.
pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for subdivisions in SUBDIVISIONS {
        let (vertices, faces) = icosphere(subdivisions);
        cases.push(case("icosphere", vertices.clone(), &faces));
        let (vertices, faces) = irregular(vertices, faces);
        cases.push(case("irregular", vertices, &faces));
    }
    cases
}

fn case(name: &str, mut vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Case {
    let area: f64 = faces
        .iter()
        .map(|&face| 0.5 * norm(normal(&vertices, face)))
        .sum();
    for position in &mut vertices {
        *position = position.map(|x| x / area.sqrt());
    }
    let mesh = TriangleMesh::new(vertices, faces).expect("the mesh is valid by construction");
    Case {
        label: format!("{name}/{}", mesh.n_vertices()),
        epsilon: 2.0 * mesh.mean_edge_length(),
        surface: Arc::new(Surface::new(mesh)),
    }
}

fn icosphere(subdivisions: u32) -> (Vec<[f64; 3]>, Vec<[i64; 3]>) {
    let golden = 0.5 * (1.0 + 5_f64.sqrt());
    let mut vertices = Vec::new();
    for (a, b) in [
        (1.0, golden),
        (-1.0, golden),
        (1.0, -golden),
        (-1.0, -golden),
    ] {
        vertices.extend([[a, b, 0.0], [0.0, a, b], [b, 0.0, a]].map(unit));
    }
    let edge = distance(vertices[0], vertices[3]);
    let joined = |a: usize, b: usize| distance(vertices[a], vertices[b]) < 1.1 * edge;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|&b| joined(a, b)) {
            for c in (b + 1..12).filter(|&c| joined(a, c) && joined(b, c)) {
                let face = [a, b, c].map(|v| v as i64);
                let outwards = dot(normal(&vertices, face), vertices[a]) > 0.0;
                faces.push(if outwards {
                    face
                } else {
                    [face[0], face[2], face[1]]
                });
            }
        }
    }
    for _ in 0..subdivisions {
        let mut midpoints = BTreeMap::new();
        let mut finer = Vec::with_capacity(4 * faces.len());
        for &[a, b, c] in &faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
                *midpoints.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let (p, q) = (vertices[a as usize], vertices[b as usize]);
                    vertices.push(unit([0, 1, 2].map(|k| p[k] + q[k])));
                    vertices.len() as i64 - 1
                })
            });
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = finer;
    }
    (vertices, faces)
}

/// Moves the vertices of a sphere along it at random, flips edges, bends it into a body with
/// bumps whose triangles differ in size, and numbers vertices and faces at random.
fn irregular(
    mut vertices: Vec<[f64; 3]>,
    mut faces: Vec<[i64; 3]>,
) -> (Vec<[f64; 3]>, Vec<[i64; 3]>) {
    let mut random = Random(1);
    let size = JITTER * (4.0 * PI / vertices.len() as f64).sqrt();
    for position in &mut vertices {
        *position = unit(position.map(|x| x + size * (2.0 * random.uniform() - 1.0)));
    }
    flip_edges(&vertices, &mut faces);
    for position in &mut vertices {
        let [x, y, z] = *position;
        let radius = 1.0 + 0.3 * (3.0 * x + 1.0).sin() * (4.0 * y).cos() + 0.4 * z.powi(3);
        *position = position.map(|x| radius * x);
    }
    let order = random.permutation(vertices.len());
    let mut shuffled = vertices.clone();
    for (position, &new) in vertices.iter().zip(&order) {
        shuffled[new] = *position;
    }
    let faces = random
        .permutation(faces.len())
        .iter()
        .map(|&f| faces[f].map(|v| order[v as usize] as i64))
        .collect();
    (shuffled, faces)
}

/// Flips every edge whose two faces are still as they were and give two good triangles; the ends
/// keep at least four neighbours, so that no edge can arise twice.
fn flip_edges(vertices: &[[f64; 3]], faces: &mut [[i64; 3]]) {
    let mut sides: BTreeMap<(i64, i64), (usize, i64)> = BTreeMap::new();
    let mut valences = vec![0_u32; vertices.len()];
    for (f, &[a, b, c]) in faces.iter().enumerate() {
        for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
            sides.insert((from, to), (f, opposite));
            valences[from as usize] += 1;
        }
    }
    let mut touched = vec![false; faces.len()];
    for (&(a, b), &(f, c)) in &sides {
        let (g, d) = sides[&(b, a)];
        let new = [[c, a, d], [d, b, c]];
        if a < b
            && !touched[f]
            && !touched[g]
            && valences[a as usize].min(valences[b as usize]) > 4
            && new.iter().all(|&face| is_good(vertices, face))
        {
            (faces[f], faces[g]) = (new[0], new[1]);
            (touched[f], touched[g]) = (true, true);
            valences[a as usize] -= 1;
            valences[b as usize] -= 1;
            valences[c as usize] += 1;
            valences[d as usize] += 1;
        }
    }
}

fn is_good(vertices: &[[f64; 3]], face: [i64; 3]) -> bool {
    let [a, b, c] = face.map(|v| vertices[v as usize]);
    let squares = distance(a, b).powi(2) + distance(b, c).powi(2) + distance(c, a).powi(2);
    2.0 * 3_f64.sqrt() * dot(normal(vertices, face), unit(a)) / squares > FLIP_QUALITY
}

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    /// The next number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn permutation(&mut self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            order.swap(i, (self.uniform() * (i + 1) as f64) as usize);
        }
        order
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// The direction of `a`.
pub fn unit(a: [f64; 3]) -> [f64; 3] {
    a.map(|x| x / norm(a))
}

/// The distance of two points.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm([0, 1, 2].map(|k| a[k] - b[k]))
}

/// Twice the area of a face along its normal.
fn normal(vertices: &[[f64; 3]], face: [i64; 3]) -> [f64; 3] {
    let [a, b, c] = face.map(|v| vertices[v as usize]);
    let (p, q) = (
        [0, 1, 2].map(|k| b[k] - a[k]),
        [0, 1, 2].map(|k| c[k] - a[k]),
    );
    [
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    ]
}
