//! The map of a disk that keeps lengths best, without a flip or an overlap.

use super::bff::bff;
use super::contact::{Barrier, Contact};
use super::dirichlet::{Elements, LEAST};
use super::disk::boundary_of_disk;
use super::mend::mended;
use super::newton::{Step, System, ordered};
use super::polygon::{Point, is_simple, turn};
use super::subspace::Subspace;
use super::tutte::tutte;
use crate::error::{Error, Result};
use crate::mesh::{NONE, TriangleMesh};

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
/// Faces above which the vertices of a conformal map move with those of a simplified disk alone.
const LARGE: usize = 40_000;

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
    let found = bff(mesh).ok().and_then(|flat| {
        let uv = flat.uv;
        if mesh.n_faces() > LARGE {
            mended(mesh, uv)
        } else {
            Some(uv)
        }
    });
    let found = found.filter(valid);
    let conformal = found.is_some();
    let start = match found {
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
    let [squares, inverses, _] = elements.parts(&uv);
    let scale = (inverses / squares).sqrt().sqrt();
    if !scale.is_finite() {
        return Ok(start);
    }
    for p in &mut uv {
        *p = p.map(|x| scale * x);
    }
    let mut newton: Option<Newton> = None;
    let all = |uv: &[Point], contacts: &[Contact]| -> Result<Option<Step>> {
        let system = match newton.take() {
            Some(system) if system.holds(contacts) => system,
            _ => Newton::new(mesh, contacts)?,
        };
        Ok(newton.insert(system).step(&elements, uv, contacts))
    };
    if mesh.n_faces() > LARGE {
        let mut subspace = Subspace::new(mesh);
        let few = |uv: &[Point], contacts: &[Contact]| subspace.step(&elements, uv, contacts);
        uv = minimise(mesh, boundary, &elements, uv, few)?;
    }
    if mesh.n_faces() <= LARGE || !conformal {
        uv = minimise(mesh, boundary, &elements, uv, all)?;
    }
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

/// Moves a map down the energy, by the steps that `step` finds from a map and what is in contact.
fn minimise(
    mesh: &TriangleMesh,
    boundary: &[u32],
    elements: &Elements,
    mut uv: Vec<Point>,
    mut step: impl FnMut(&[Point], &[Contact]) -> Result<Option<Step>>,
) -> Result<Vec<Point>> {
    let side = perimeter(&polygon(boundary, &uv)) / boundary.len() as f64;
    let weight = REPULSION / mesh.n_faces() as f64;
    let barrier = Barrier::new(boundary, &uv, REACH * side, weight);
    let mut elastic = elements.energy(&uv);
    let mut energy = elastic + barrier.value(&uv);
    for _ in 0..MAX_STEPS {
        let contacts = barrier.contacts(&uv);
        let Some(Step { direction, slope }) = step(&uv, &contacts)? else {
            break;
        };
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
        if gain <= REST * (elastic - LEAST) + ROUNDING {
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

/// The Newton system of all vertices.
struct Newton {
    system: System,
    /// The places of the three sides of each face.
    sides: Vec<[u32; 3]>,
}

impl Newton {
    fn new(mesh: &TriangleMesh, contacts: &[Contact]) -> Result<Self> {
        let mut pairs: Vec<(u32, u32)> = mesh.edges().iter().map(|&[a, b]| (a, b)).collect();
        for contact in contacts {
            let [p, a, b] = contact.vertices;
            pairs.extend([ordered(p, a), ordered(p, b)]);
        }
        let system = System::new(mesh.n_vertices(), pairs)?;
        let place = |a: u32, b: u32| system.sums.place(a, b).map_or(NONE, |place| place as u32);
        let sides = mesh
            .faces()
            .iter()
            .map(|&[a, b, c]| [place(a, b), place(b, c), place(c, a)])
            .collect();
        Ok(Self { system, sides })
    }

    /// Whether the matrix has a block for all pairs of vertices in contact.
    fn holds(&self, contacts: &[Contact]) -> bool {
        contacts.iter().all(|contact| {
            let [p, a, b] = contact.vertices;
            [a, b]
                .into_iter()
                .all(|q| self.system.sums.place(p, q).is_some())
        })
    }

    /// The Newton step; [`None`] at rest, or where no shift makes the matrix definite.
    fn step(&mut self, elements: &Elements, uv: &[Point], contacts: &[Contact]) -> Option<Step> {
        let sums = &mut self.system.sums;
        sums.clear();
        for (f, face) in elements.faces.iter().enumerate() {
            let derivatives = elements.derivatives(f, uv);
            for k in 0..3 {
                let next = (k + 1) % 3;
                let (a, b) = (face[k], face[next]);
                sums.add_gradient(a, derivatives.gradient[k]);
                sums.add_diagonal(a, derivatives.hessian[k][k]);
                let side = self.sides[f][k] as usize;
                sums.add_pair(side, a, b, derivatives.hessian[k][next]);
            }
        }
        for contact in contacts {
            for i in 0..3 {
                let (a, [x, y]) = (contact.vertices[i], contact.directions[i]);
                sums.add_gradient(a, [contact.slope * x, contact.slope * y]);
                sums.add_diagonal(a, contact.block(i, i));
                let j = (i + 1) % 3;
                let b = contact.vertices[j];
                if let Some(pair) = sums.place(a, b) {
                    sums.add_pair(pair, a, b, contact.block(i, j));
                }
            }
        }
        self.system.step()
    }
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
        assert!((elements.energy(&uv) - LEAST).abs() < 1e-12);
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
            let [squares, inverses, angles] = elements.parts(&relative);
            2.0 * (squares * inverses).sqrt() + angles - LEAST
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
