//! The map of a disk that keeps lengths best, without a flip or an overlap.

use std::sync::Arc;

use super::bff::bff;
use super::contact::{Barrier, Contact};
use super::dirichlet::{Elements, Matrix2};
use super::disk::boundary_of_disk;
use super::polygon::{Point, is_simple, turn};
use super::tutte::tutte;
use crate::error::{Error, Result};
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::TriangleMesh;

/// Steps; from a boundary-first map five to fifteen do.
const MAX_STEPS: usize = 100;
/// Gain of a step, relative to the energy above that of an isometry, at which the map is at rest,
/// and the energy that is rounding.
const REST: f64 = 1e-3;
const ROUNDING: f64 = 1e-13;
/// Part of the way to the first face without area that a step may go.
const SHORT_OF_FLAT: f64 = 0.8;
/// Halvings of a step, and the part of the gain that the slope promises which is enough (Armijo).
const MAX_HALVINGS: usize = 40;
const ENOUGH: f64 = 1e-4;
/// Distance at which boundaries repel each other, in mean lengths of a side.
const REACH: f64 = 0.1;
/// Energy of a vertex at half that distance from a side, relative to that of a mean face.
const REPULSION: f64 = 1e-3;
/// Added to the diagonal, as translations and rotations cost nothing, relative to each entry; more
/// where rounding spoils the factorisation.
const SHIFTS: [f64; 4] = [1e-12, 1e-9, 1e-6, 1e-3];

/// Flattens a disk by the bijection that keeps lengths best: of least symmetric Dirichlet energy.
///
/// Newton's method on the Hessian made positive semidefinite face by face starts from the
/// boundary-first map, or from that of Tutte where the former is no bijection. No step turns a face
/// over or makes the boundary cross itself; boundaries that come close repel each other, so that
/// contact does not hold the rest of the map back.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::isometric;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [0.0, 3.0, 0.0], [0.0, 3.0, 3.0], [0.0, 0.0, 3.0]];
/// let uv = isometric(&TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?)?;
/// let side = (0..2).map(|k| uv[1][k] - uv[0][k]).map(|x| x * x).sum::<f64>().sqrt();
/// assert!((side - 3.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Topology`] for a mesh that is no disk, or one so long that a map without a flip has
/// faces below rounding.
pub fn isometric(mesh: &TriangleMesh) -> Result<Vec<Point>> {
    let boundary = boundary_of_disk(mesh)?;
    let valid = |uv: &Vec<Point>| is_upright(mesh, uv) && is_simple(&polygon(boundary, uv));
    let conformal = bff(mesh).ok().map(|flat| flat.uv).filter(valid);
    let start = match conformal {
        Some(uv) => uv,
        None => tutte(mesh, boundary).and_then(|uv| {
            valid(&uv).then_some(uv).ok_or_else(|| Error::Topology {
                argument: "mesh",
                reason: "no map to the plane keeps all faces above rounding".into(),
            })
        })?,
    };
    // Lengths relative to the root of the area.
    let unit = mesh.area().sqrt();
    let elements = Elements::new(mesh, unit);
    let mut uv: Vec<Point> = start.iter().map(|p| p.map(|x| x / unit)).collect();
    let [squares, inverses] = elements.parts(&uv);
    let scale = (inverses / squares).sqrt().sqrt();
    if !scale.is_finite() {
        return Ok(start);
    }
    for p in &mut uv {
        *p = p.map(|x| scale * x);
    }
    let uv = minimise(mesh, boundary, &elements, uv)?;
    let scaled: Vec<Point> = uv.iter().map(|p| p.map(|x| unit * x)).collect();
    // Scaling rounds.
    Ok(if valid(&scaled) { scaled } else { start })
}

fn polygon(boundary: &[u32], uv: &[Point]) -> Vec<Point> {
    boundary.iter().map(|&v| uv[v as usize]).collect()
}

fn is_upright(mesh: &TriangleMesh, uv: &[Point]) -> bool {
    mesh.faces().iter().all(|face| {
        let [a, b, c] = face.map(|v| uv[v as usize]);
        turn(a, b, c) > 0.0
    })
}

fn minimise(
    mesh: &TriangleMesh,
    boundary: &[u32],
    elements: &Elements,
    mut uv: Vec<Point>,
) -> Result<Vec<Point>> {
    let side = perimeter(&polygon(boundary, &uv)) / boundary.len() as f64;
    let weight = REPULSION / mesh.n_faces() as f64;
    let barrier = Barrier::new(boundary, &uv, REACH * side, weight);
    let mut elastic = elements.energy(&uv);
    let mut energy = elastic + barrier.value(&uv);
    let mut newton: Option<Newton> = None;
    for _ in 0..MAX_STEPS {
        let contacts = barrier.contacts(&uv);
        let mut system = match newton.take() {
            Some(system) if system.holds(&contacts) => system,
            _ => Newton::new(mesh, &contacts)?,
        };
        let Some(Step { direction, slope }) = system.step(elements, &uv, &contacts) else {
            break;
        };
        newton = Some(system);
        let mut length = longest_step(elements, &uv, &direction).min(1.0);
        let mut moved = None;
        for _ in 0..MAX_HALVINGS {
            let trial: Vec<Point> = uv
                .iter()
                .zip(&direction)
                .map(|(p, d)| [p[0] + length * d[0], p[1] + length * d[1]])
                .collect();
            let trial_elastic = elements.energy(&trial);
            if trial_elastic < energy {
                let trial_energy = trial_elastic + barrier.value(&trial);
                if trial_energy <= energy + ENOUGH * length * slope
                    && is_upright(mesh, &trial)
                    && is_simple(&polygon(boundary, &trial))
                {
                    moved = Some((trial, trial_elastic, trial_energy));
                    break;
                }
            }
            length *= 0.5;
        }
        let Some((trial, trial_elastic, trial_energy)) = moved else {
            break;
        };
        let gain = energy - trial_energy;
        (uv, elastic, energy) = (trial, trial_elastic, trial_energy);
        if gain <= REST * (elastic - 4.0) + ROUNDING {
            break;
        }
    }
    Ok(uv)
}

fn perimeter(points: &[Point]) -> f64 {
    let n = points.len();
    (0..n)
        .map(|i| {
            let (p, q) = (points[i], points[(i + 1) % n]);
            (p[0] - q[0]).hypot(p[1] - q[1])
        })
        .sum()
}

/// The part of a step that stays short of the first face without area, the least root of a quadratic
/// for each face.
fn longest_step(elements: &Elements, uv: &[Point], direction: &[Point]) -> f64 {
    let mut least = f64::INFINITY;
    for face in &elements.faces {
        let [p, d] = [uv, direction].map(|points| {
            let [a, b, c] = face.map(|v| points[v as usize]);
            [[b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]]
        });
        let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
        let constant = cross(p[0], p[1]);
        let linear = cross(p[0], d[1]) + cross(d[0], p[1]);
        let square = cross(d[0], d[1]);
        // The root in a form that loses no digits; a root that is not there is infinite or NaN.
        let root = (linear * linear - 4.0 * square * constant).sqrt();
        let first = if linear < 0.0 {
            2.0 * constant / (root - linear)
        } else {
            -(linear + root) / (2.0 * square)
        };
        if first > 0.0 && first < least {
            least = first;
        }
    }
    SHORT_OF_FLAT * least
}

/// The Newton system of a map, in the unknowns 2 v and 2 v + 1 of each vertex.
struct Newton {
    /// Pairs of vertices, lower number first, that share a block of the matrix; sorted.
    pairs: Vec<(u32, u32)>,
    /// Where the pairs of each vertex begin.
    starts: Vec<usize>,
    /// The pairs of the three sides of each face.
    sides: Vec<[u32; 3]>,
    values: Vec<f64>,
    right: Vec<f64>,
    cholesky: Cholesky,
}

struct Step {
    direction: Vec<Point>,
    /// Of the energy in that direction.
    slope: f64,
}

impl Newton {
    fn new(mesh: &TriangleMesh, contacts: &[Contact]) -> Result<Self> {
        let n = mesh.n_vertices();
        let mut pairs: Vec<(u32, u32)> = mesh.edges().iter().map(|&[a, b]| (a, b)).collect();
        for contact in contacts {
            let [p, a, b] = contact.vertices;
            pairs.extend([ordered(p, a), ordered(p, b)]);
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; n + 1];
        for (i, pair) in pairs.iter().enumerate() {
            starts[pair.0 as usize + 1] = i + 1;
        }
        for v in 0..n {
            starts[v + 1] = starts[v + 1].max(starts[v]);
        }
        let mut column_starts = vec![0];
        let mut rows = Vec::with_capacity(4 * pairs.len() + 3 * n);
        for v in 0..n {
            for axis in 0..2 {
                rows.extend((axis..2).map(|r| (2 * v + r) as u32));
                for pair in &pairs[starts[v]..starts[v + 1]] {
                    rows.extend([2 * pair.1, 2 * pair.1 + 1]);
                }
                column_starts.push(rows.len());
            }
        }
        let symbolic = SymbolicFactorisation::new(
            &column_starts,
            &rows,
            Ordering::MinimumDegree,
            Factorisation::Automatic,
        )?;
        let place = |a: u32, b: u32| pairs.partition_point(|&pair| pair < ordered(a, b)) as u32;
        let sides = mesh
            .faces()
            .iter()
            .map(|&[a, b, c]| [place(a, b), place(b, c), place(c, a)])
            .collect();
        Ok(Self {
            values: vec![0.0; rows.len()],
            right: vec![0.0; 2 * n],
            sides,
            pairs,
            starts,
            cholesky: Cholesky::new(Arc::new(symbolic))?,
        })
    }

    /// Whether the matrix has a block for all pairs of vertices in contact.
    fn holds(&self, contacts: &[Contact]) -> bool {
        contacts.iter().all(|contact| {
            let [p, a, b] = contact.vertices;
            [a, b]
                .into_iter()
                .all(|q| self.pairs.binary_search(&ordered(p, q)).is_ok())
        })
    }

    /// Place of the first value of column 2 v + axis.
    fn column(&self, v: usize, axis: usize) -> usize {
        let first = 3 * v + 4 * self.starts[v];
        let count = self.starts[v + 1] - self.starts[v];
        first + axis * (2 + 2 * count)
    }

    fn add_diagonal(&mut self, v: u32, block: Matrix2) {
        let (x, y) = (self.column(v as usize, 0), self.column(v as usize, 1));
        self.values[x] += block[0][0];
        self.values[x + 1] += block[1][0];
        self.values[y] += block[1][1];
    }

    /// Adds the block (a, b) that stands at place `pair`.
    fn add_pair(&mut self, pair: usize, a: u32, b: u32, block: Matrix2) {
        let v = a.min(b) as usize;
        let k = pair - self.starts[v];
        for axis in 0..2 {
            let place = self.column(v, axis) + 2 - axis + 2 * k;
            for r in 0..2 {
                self.values[place + r] += if a < b {
                    block[axis][r]
                } else {
                    block[r][axis]
                };
            }
        }
    }

    /// The Newton step; [`None`] at rest, or where no shift makes the matrix definite.
    fn step(&mut self, elements: &Elements, uv: &[Point], contacts: &[Contact]) -> Option<Step> {
        self.values.fill(0.0);
        self.right.fill(0.0);
        for (f, face) in elements.faces.iter().enumerate() {
            let derivatives = elements.derivatives(f, uv);
            for k in 0..3 {
                let next = (k + 1) % 3;
                let (a, b) = (face[k], face[next]);
                for axis in 0..2 {
                    self.right[2 * a as usize + axis] -= derivatives.gradient[k][axis];
                }
                self.add_diagonal(a, derivatives.hessian[k][k]);
                let side = self.sides[f][k] as usize;
                self.add_pair(side, a, b, derivatives.hessian[k][next]);
            }
        }
        for contact in contacts {
            let outer = |i: usize, j: usize| {
                [0, 1].map(|r| {
                    [0, 1].map(|c| {
                        contact.curvature * contact.directions[i][r] * contact.directions[j][c]
                    })
                })
            };
            for i in 0..3 {
                let a = contact.vertices[i];
                for axis in 0..2 {
                    self.right[2 * a as usize + axis] -=
                        contact.slope * contact.directions[i][axis];
                }
                self.add_diagonal(a, outer(i, i));
                let j = (i + 1) % 3;
                let b = contact.vertices[j];
                if let Ok(pair) = self.pairs.binary_search(&ordered(a, b)) {
                    self.add_pair(pair, a, b, outer(i, j));
                }
            }
        }
        let n = uv.len();
        let diagonal: Vec<usize> = (0..2 * n).map(|i| self.column(i / 2, i % 2)).collect();
        let values: Vec<f64> = diagonal.iter().map(|&place| self.values[place]).collect();
        for shift in SHIFTS {
            for (&place, value) in diagonal.iter().zip(&values) {
                self.values[place] = value * (1.0 + shift);
            }
            if self.cholesky.factor(&self.values).is_err() {
                continue;
            }
            let mut direction = self.right.clone();
            self.cholesky.solve(&mut direction).ok()?;
            let slope = -direction
                .iter()
                .zip(&self.right)
                .map(|(d, r)| d * r)
                .sum::<f64>();
            if slope < 0.0 && slope.is_finite() {
                return Some(Step {
                    direction: direction.as_chunks().0.to_vec(),
                    slope,
                });
            }
        }
        None
    }
}

fn ordered(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn folded_sheet_is_flattened_exactly() {
        let mesh = grid(14, 9, |x, _| (3.0 * x).min(1.0));
        let uv = isometric(&mesh).unwrap();
        let elements = Elements::new(&mesh, 1.0);
        assert!((elements.energy(&uv) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn dome_is_less_stretched_than_by_a_conformal_map() {
        let mesh = grid(30, 30, |x, y| {
            (1.0 - (x - 0.5).powi(2) - (y - 0.5).powi(2)).sqrt()
        });
        let unit = mesh.area().sqrt();
        let elements = Elements::new(&mesh, unit);
        let energy = |uv: &[Point]| {
            let relative: Vec<Point> = uv.iter().map(|p| p.map(|x| x / unit)).collect();
            let [squares, inverses] = elements.parts(&relative);
            2.0 * (squares * inverses).sqrt() - 4.0
        };
        let (before, after) = (
            energy(&bff(&mesh).unwrap().uv),
            energy(&isometric(&mesh).unwrap()),
        );
        assert!(after < 0.7 * before, "{after} {before}");
    }

    #[test]
    fn ramp_that_overlaps_itself_is_drawn_apart() {
        // A ramp of 1.3 turns: the boundary-first map covers three tenths of it twice.
        let (along, across) = (100, 8);
        let flat = grid(along, across, |_, _| 0.0);
        let vertices = flat
            .vertices()
            .iter()
            .map(|p| {
                let (sin, cos) = (1.3 * std::f64::consts::TAU * p[0]).sin_cos();
                let r = 2.0 - p[1];
                [r * cos, r * sin, 0.5 * p[0]]
            })
            .collect();
        let faces: Vec<[i64; 3]> = flat.faces().iter().map(|f| f.map(i64::from)).collect();
        let mesh = TriangleMesh::new(vertices, &faces).unwrap();
        let boundary = &mesh.boundary_loops()[0];
        assert!(!is_simple(&polygon(boundary, &bff(&mesh).unwrap().uv)));
        let uv = isometric(&mesh).unwrap();
        assert!(is_upright(&mesh, &uv) && is_simple(&polygon(boundary, &uv)));
        let energy = Elements::new(&mesh, 1.0).energy(&uv);
        assert!(energy < 4.5, "{energy}");
    }
}
