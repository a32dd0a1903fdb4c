//! Moves of all vertices of a disk by those of a simplified one: few unknowns for a fine map.

use rayon::prelude::*;

use super::contact::Contact;
use super::dirichlet::{Elements, Matrix2};
use super::newton::{Step, Sums, System, ordered};
use super::polygon::Point;
use crate::error::Result;
use crate::mesh::{NONE, TriangleMesh, dot, subtract};
use crate::simplify::simplify;

/// Faces of the simplified disk.
const FACES: usize = 4000;
/// Tasks that the faces are shared out among; the sums of each are added in order.
const TASKS: usize = 16;
/// Faces that a vertex may walk across to the nearest one.
const WALK: usize = 16;

/// Corners of the simplified disk that move a vertex, and their weights.
type Weights = ([u32; 3], [f64; 3]);

/// Moves that are linear on the faces of a simplified disk, where a vertex moves as the nearest point
/// there does.
pub(super) struct Subspace {
    size: usize,
    weights: Vec<Weights>,
    /// Pairs of corners that move a face together.
    pairs: Vec<(u32, u32)>,
    system: Option<System>,
}

/// The corners that move the vertices of a face or a contact, and the weight of each at each vertex.
#[derive(Default)]
struct Nodes {
    corners: [u32; 9],
    weights: [[f64; 3]; 9],
    count: usize,
}

impl Nodes {
    fn new(weights: &[Weights], vertices: [u32; 3]) -> Self {
        let mut nodes = Self::default();
        for (i, v) in vertices.into_iter().enumerate() {
            let (corners, shares) = weights[v as usize];
            for (corner, share) in corners.into_iter().zip(shares) {
                if share == 0.0 {
                    continue;
                }
                let known = nodes.corners[..nodes.count].iter();
                let k = known
                    .copied()
                    .position(|c| c == corner)
                    .unwrap_or(nodes.count);
                if k == nodes.count {
                    nodes.corners[k] = corner;
                    nodes.count += 1;
                }
                nodes.weights[k][i] = share;
            }
        }
        nodes
    }

    /// Adds a gradient in the three vertices, and the blocks of a Hessian, as the corners see them.
    fn add(&self, sums: &mut Sums, gradient: [Point; 3], block: impl Fn(usize, usize) -> Matrix2) {
        let blocks = [0, 1, 2].map(|i| [0, 1, 2].map(|j| block(i, j)));
        let corners = self.corners[..self.count].iter().zip(&self.weights);
        for (k, (&a, shares)) in corners.enumerate() {
            sums.add_gradient(
                a,
                [0, 1].map(|axis| (0..3).map(|i| shares[i] * gradient[i][axis]).sum()),
            );
            // The rows of corner a against the three vertices.
            let rows = [0, 1, 2].map(|j| combined(shares, |i| blocks[i][j]));
            sums.add_diagonal(a, combined(shares, |j| rows[j]));
            for (&b, others) in self.corners[..k].iter().zip(&self.weights) {
                if let Some(pair) = sums.place(a, b) {
                    sums.add_pair(pair, a, b, combined(others, |j| rows[j]));
                }
            }
        }
    }

    fn pairs(&self) -> impl Iterator<Item = (u32, u32)> {
        let corners = &self.corners[..self.count];
        (0..corners.len()).flat_map(move |i| (0..i).map(move |j| ordered(corners[i], corners[j])))
    }
}

impl Subspace {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let coarse = simplify(mesh, FACES);
        let size = coarse.vertices.len();
        let mut at: Vec<Vec<u32>> = vec![Vec::new(); size];
        for (f, face) in (0..).zip(&coarse.faces) {
            for &v in face {
                at[v as usize].push(f);
            }
        }
        let weights: Vec<Weights> = mesh
            .vertices()
            .par_iter()
            .zip(&coarse.collapsed_to)
            .map(|(&point, &start)| {
                let mut best = (f64::INFINITY, ([start; 3], [1.0, 0.0, 0.0]));
                let mut around = vec![start];
                for _ in 0..WALK {
                    let before = best.0;
                    for &f in around.iter().flat_map(|&v| &at[v as usize]) {
                        let face = coarse.faces[f as usize];
                        let corners = face.map(|v| coarse.vertices[v as usize]);
                        let (distance, shares) = nearest(corners, point);
                        if distance < best.0 {
                            best = (distance, (face, shares));
                        }
                    }
                    if best.0 >= before {
                        break;
                    }
                    around = best.1.0.to_vec();
                }
                best.1
            })
            .collect();
        let (weights, size) = used(weights, size);
        let faces = mesh.faces();
        let parts: Vec<Vec<(u32, u32)>> = faces
            .par_chunks(faces.len().div_ceil(TASKS))
            .map(|faces| {
                let nodes = faces.iter().map(|&face| Nodes::new(&weights, face));
                let mut pairs: Vec<_> = nodes
                    .flat_map(|nodes| nodes.pairs().collect::<Vec<_>>())
                    .collect();
                pairs.sort_unstable();
                pairs.dedup();
                pairs
            })
            .collect();
        Self {
            size,
            weights,
            pairs: parts.concat(),
            system: None,
        }
    }

    /// The Newton step among these moves; [`None`] at rest.
    pub fn step(
        &mut self,
        elements: &Elements,
        uv: &[Point],
        contacts: &[Contact],
    ) -> Result<Option<Step>> {
        let touching: Vec<Nodes> = contacts
            .iter()
            .map(|contact| Nodes::new(&self.weights, contact.vertices))
            .collect();
        let held = |system: &System| {
            let mut pairs = touching.iter().flat_map(Nodes::pairs);
            pairs.all(|(a, b)| system.sums.place(a, b).is_some())
        };
        let mut system = match self.system.take() {
            Some(system) if held(&system) => system,
            _ => {
                let mut pairs = self.pairs.clone();
                pairs.extend(touching.iter().flat_map(Nodes::pairs));
                System::new(self.size, pairs)?
            }
        };
        system.sums.clear();
        let n = elements.faces.len();
        let width = n.div_ceil(TASKS);
        let blank = &system.sums;
        let parts: Vec<Sums> = (0..TASKS)
            .into_par_iter()
            .map(|task| {
                let mut sums = blank.clone();
                for f in (task * width).min(n)..((task + 1) * width).min(n) {
                    let nodes = Nodes::new(&self.weights, elements.faces[f]);
                    let derivatives = elements.derivatives(f, uv);
                    nodes.add(&mut sums, derivatives.gradient, |i, j| {
                        derivatives.hessian[i][j]
                    });
                }
                sums
            })
            .collect();
        for part in &parts {
            system.sums.add(part);
        }
        for (contact, nodes) in contacts.iter().zip(&touching) {
            let gradient = contact.directions.map(|d| d.map(|x| contact.slope * x));
            nodes.add(&mut system.sums, gradient, |i, j| contact.block(i, j));
        }
        let step = system.step().map(|step| Step {
            direction: self.spread(&step.direction),
            slope: step.slope,
        });
        self.system = Some(system);
        Ok(step)
    }

    /// The moves of all vertices.
    fn spread(&self, moves: &[Point]) -> Vec<Point> {
        let moved = |(corners, shares): &Weights| {
            [0, 1].map(|axis| {
                let at = corners.iter().zip(shares);
                at.map(|(&c, share)| share * moves[c as usize][axis]).sum()
            })
        };
        self.weights.par_iter().map(moved).collect()
    }
}

fn combined(shares: &[f64; 3], block: impl Fn(usize) -> Matrix2) -> Matrix2 {
    let mut sum = [[0.0; 2]; 2];
    for (i, share) in shares.iter().enumerate() {
        let block = block(i);
        for r in 0..2 {
            for c in 0..2 {
                sum[r][c] += share * block[r][c];
            }
        }
    }
    sum
}

/// The corners that move a vertex, numbered anew, and how many there are.
fn used(mut weights: Vec<Weights>, size: usize) -> (Vec<Weights>, usize) {
    let mut numbers = vec![NONE; size];
    let mut count = 0;
    for (corners, shares) in &weights {
        for (&corner, &share) in corners.iter().zip(shares) {
            if share != 0.0 && numbers[corner as usize] == NONE {
                numbers[corner as usize] = count;
                count += 1;
            }
        }
    }
    for (corners, shares) in &mut weights {
        for (corner, share) in corners.iter_mut().zip(shares) {
            // One without a share is any.
            let number = numbers[*corner as usize];
            *corner = if *share == 0.0 { 0 } else { number };
        }
    }
    (weights, count as usize)
}

/// Squared distance of a point from a triangle, and the barycentric coordinates of the nearest point
/// there.
fn nearest(corners: [[f64; 3]; 3], point: [f64; 3]) -> (f64, [f64; 3]) {
    let [a, b, c] = corners;
    let (along, up, to) = (subtract(b, a), subtract(c, a), subtract(point, a));
    let (aa, bb, ab) = (dot(along, along), dot(up, up), dot(along, up));
    let (pa, pb) = (dot(to, along), dot(to, up));
    let determinant = aa * bb - ab * ab;
    let (s, t) = (
        (bb * pa - ab * pb) / determinant,
        (aa * pb - ab * pa) / determinant,
    );
    let at = |shares: [f64; 3]| {
        let place = [0, 1, 2].map(|k| (0..3).map(|i| shares[i] * corners[i][k]).sum());
        let away = subtract(point, place);
        (dot(away, away), shares)
    };
    if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
        return at([1.0 - s - t, s, t]);
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for k in 0..3 {
        let next = (k + 1) % 3;
        let side = subtract(corners[next], corners[k]);
        let place = (dot(subtract(point, corners[k]), side) / dot(side, side)).clamp(0.0, 1.0);
        let mut shares = [0.0; 3];
        (shares[k], shares[next]) = (1.0 - place, place);
        let found = at(shares);
        if found.0 < best.0 {
            best = found;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn weights_give_the_nearest_point() {
        let corners = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        for (point, shares, distance) in [
            ([0.5, 0.25, 0.3], [0.5, 0.25, 0.25], 0.09),
            ([1.0, -2.0, 0.0], [0.5, 0.5, 0.0], 4.0),
            ([-1.0, 5.0, 0.0], [0.0, 0.0, 1.0], 17.0),
        ] {
            let found = nearest(corners, point);
            assert!((found.0 - distance).abs() < 1e-12);
            let pairs = found.1.iter().zip(shares);
            assert!(pairs.into_iter().all(|(x, y)| (x - y).abs() < 1e-12));
        }
    }

    /// All moves together are those of the mesh where every vertex has one of its own.
    #[test]
    fn slope_is_that_of_differences() {
        let mesh = grid(60, 60, |x, y| {
            (1.0 - (x - 0.5).powi(2) - (y - 0.5).powi(2)).sqrt()
        });
        let elements = Elements::new(&mesh, mesh.area().sqrt());
        let uv: Vec<Point> = mesh.vertices().iter().map(|p| [p[0], p[1]]).collect();
        let mut subspace = Subspace::new(&mesh);
        assert!(subspace.size < 2500);
        let Step { direction, slope } = subspace.step(&elements, &uv, &[]).unwrap().unwrap();
        let energy = |length: f64| {
            let moved = uv.iter().zip(&direction);
            let moved: Vec<Point> = moved
                .map(|(p, d)| [p[0] + length * d[0], p[1] + length * d[1]])
                .collect();
            elements.energy(&moved)
        };
        let step = 1e-4;
        let found = (energy(step) - energy(-step)) / (2.0 * step);
        assert!((found / slope - 1.0).abs() < 1e-4, "{found} {slope}");
        assert!(energy(1.0) < energy(0.0));
    }
}
