//! Least-squares conformal map of a disk in its spectral form (Levy et al. 2002; Mullen et al.
//! 2008).

use std::collections::BTreeMap;
use std::sync::Arc;

use super::disk::boundary_of_disk;
use crate::error::{Error, Result};
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::{NONE, TriangleMesh, distance};
use crate::operators::Stiffness;

/// Shift of the conformal energy, which is singular on translations, relative to its diagonal.
const SHIFT: f64 = 1e-10;
const MAX_ITERATIONS: usize = 200;
/// Change of the normalised map, per iteration, at which the iteration stops.
const TOLERANCE: f64 = 1e-9;

/// Flattens a disk: the map of least conformal energy E = Dirichlet energy - area among those
/// of unit norm on the boundary and mean zero there. No vertex is pinned.
///
/// Returns one point a vertex. The scale is such that the area in the plane equals that of the
/// mesh; the orientation is kept.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::lscm;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [0.0, 3.0, 0.0], [0.0, 3.0, 3.0], [0.0, 0.0, 3.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let uv = lscm(&square)?;
/// let side = (0..2).map(|k| uv[1][k] - uv[0][k]).map(|x| x * x).sum::<f64>().sqrt();
/// assert!((side - 3.0).abs() < 1e-6);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Topology`] for a mesh that is no disk, [`Error::NotPositiveDefinite`] where
/// rounding spoils the factorisation of extreme needles.
pub fn lscm(mesh: &TriangleMesh) -> Result<Vec<[f64; 2]>> {
    let n = mesh.n_vertices();
    let mut x = initial_map(mesh, boundary_of_disk(mesh)?);
    let mut solver = ConformalEnergy::new(mesh)?;
    let boundary: Vec<usize> = (0..n).filter(|&v| mesh.on_boundary()[v]).collect();
    normalise(&mut x, &boundary, n);
    let mut previous = x.clone();
    for _ in 0..MAX_ITERATIONS {
        // Inverse iteration for E x = lambda B x, B the indicator of the boundary.
        let mut next = vec![0.0; 2 * n];
        for &v in &boundary {
            next[v] = x[v];
            next[n + v] = x[n + v];
        }
        solver.cholesky.solve(&mut next)?;
        normalise(&mut next, &boundary, n);
        align(&mut next, &previous, n);
        let change = next
            .iter()
            .zip(&previous)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        if next.iter().any(|value| !value.is_finite()) {
            return Err(collapsed());
        }
        x.copy_from_slice(&next);
        previous = next;
        if change < TOLERANCE {
            break;
        }
    }
    let area = |x: &[f64]| -> f64 {
        mesh.faces()
            .iter()
            .map(|face| {
                let [a, b, c] = face.map(|v| v as usize);
                0.5 * ((x[b] - x[a]) * (x[n + c] - x[n + a])
                    - (x[c] - x[a]) * (x[n + b] - x[n + a]))
            })
            .sum()
    };
    let scale = (mesh.area() / area(&x)).sqrt();
    if !scale.is_finite() {
        return Err(collapsed());
    }
    Ok((0..n).map(|v| [scale * x[v], scale * x[n + v]]).collect())
}

fn collapsed() -> Error {
    Error::Topology {
        argument: "mesh",
        reason: "the conformal map collapsed: its area in the plane is not positive".into(),
    }
}

/// The factored conformal energy on the unknowns (x of every vertex, then y).
struct ConformalEnergy {
    cholesky: Cholesky,
}

impl ConformalEnergy {
    fn new(mesh: &TriangleMesh) -> Result<Self> {
        let n = mesh.n_vertices();
        let stiffness = Stiffness::new(mesh);
        let adjacency = mesh.adjacency();
        let mut columns: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); 2 * n];
        let mut largest: f64 = 0.0;
        for j in 0..n {
            let mut diagonal = 0.0;
            for (i, edge) in adjacency.around(j) {
                let value = stiffness.edge_values()[edge];
                diagonal -= value;
                if i > j {
                    columns[j].insert(i, value);
                    columns[n + j].insert(n + i, value);
                }
            }
            largest = largest.max(diagonal);
            columns[j].insert(j, diagonal);
            columns[n + j].insert(n + j, diagonal);
        }
        for column in columns.iter_mut().enumerate() {
            let (j, column) = column;
            *column.entry(j).or_default() += SHIFT * largest;
        }
        // Twice the area is a sum over the boundary edges: sum x_a y_b - x_b y_a.
        for half_edges in mesh.edge_half_edges().iter().filter(|h| h[1] == NONE) {
            let [a, b] = mesh.half_edge_ends(half_edges[0]).map(|v| v as usize);
            *columns[a].entry(n + b).or_default() -= 0.5;
            *columns[b].entry(n + a).or_default() += 0.5;
        }
        let mut starts = vec![0];
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        for column in columns {
            for (row, value) in column {
                rows.push(row as u32);
                values.push(value);
            }
            starts.push(rows.len());
        }
        let symbolic = SymbolicFactorisation::new(
            &starts,
            &rows,
            Ordering::MinimumDegree,
            Factorisation::Automatic,
        )?;
        let mut cholesky = Cholesky::new(Arc::new(symbolic))?;
        cholesky.factor(&values).map_err(|error| match error {
            Error::NotPositiveDefinite {
                argument,
                size,
                vertex,
            } => Error::NotPositiveDefinite {
                argument,
                size,
                vertex: vertex % n,
            },
            other => other,
        })?;
        Ok(Self { cholesky })
    }
}

/// The boundary on a circle by arc length, which is all that the iteration takes from its start.
fn initial_map(mesh: &TriangleMesh, boundary: &[u32]) -> Vec<f64> {
    let n = mesh.n_vertices();
    let mut length = 0.0;
    let mut places = Vec::with_capacity(boundary.len());
    for (i, &v) in boundary.iter().enumerate() {
        let (v, w) = (v as usize, boundary[(i + 1) % boundary.len()] as usize);
        places.push((v, length));
        length += distance(mesh.vertices()[v], mesh.vertices()[w]);
    }
    let mut x = vec![0.0; 2 * n];
    for (v, along) in places {
        let angle = std::f64::consts::TAU * along / length;
        x[v] = angle.cos();
        x[n + v] = angle.sin();
    }
    x
}

/// Moves the boundary's mean to the origin and its norm to one.
fn normalise(x: &mut [f64], boundary: &[usize], n: usize) {
    for part in [0, n] {
        let mean = boundary.iter().map(|&v| x[part + v]).sum::<f64>() / boundary.len() as f64;
        x[part..part + n]
            .iter_mut()
            .for_each(|value| *value -= mean);
    }
    let norm = boundary
        .iter()
        .map(|&v| x[v] * x[v] + x[n + v] * x[n + v])
        .sum::<f64>()
        .sqrt();
    for value in x {
        *value /= norm;
    }
}

/// Turns the map to the previous one: each eigenvalue is double, since the rotation of a map
/// has the same energy.
fn align(x: &mut [f64], previous: &[f64], n: usize) {
    let (mut cosine, mut sine) = (0.0, 0.0);
    for v in 0..n {
        cosine += x[v] * previous[v] + x[n + v] * previous[n + v];
        sine += x[v] * previous[n + v] - x[n + v] * previous[v];
    }
    let norm = cosine.hypot(sine);
    if norm > 0.0 {
        for v in 0..n {
            let (a, b) = (x[v], x[n + v]);
            x[v] = (cosine * a - sine * b) / norm;
            x[n + v] = (sine * a + cosine * b) / norm;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grid, torus};

    #[test]
    fn plane_is_kept() {
        let mesh = grid(12, 9, |_, _| 0.0);
        let uv = lscm(&mesh).unwrap();
        for &[a, b] in mesh.edges() {
            let [p, q] = [a, b].map(|v| mesh.vertices()[v as usize]);
            let [s, t] = [a, b].map(|v| uv[v as usize]);
            let flat = ((s[0] - t[0]).powi(2) + (s[1] - t[1]).powi(2)).sqrt();
            assert!((flat - distance(p, q)).abs() < 1e-6);
        }
    }

    #[test]
    fn developable_cylinder_is_unrolled() {
        let mesh = grid(40, 20, |_, _| 0.0);
        let bent: Vec<[f64; 3]> = mesh
            .vertices()
            .iter()
            .map(|p| [(2.0 * p[0]).sin() / 2.0, p[1], (2.0 * p[0]).cos() / 2.0])
            .collect();
        let faces: Vec<[i64; 3]> = mesh.faces().iter().map(|f| f.map(i64::from)).collect();
        let bent = TriangleMesh::new(bent, &faces).unwrap();
        let uv = lscm(&bent).unwrap();
        let diagonal = ((uv[0][0] - uv[860][0]).powi(2) + (uv[0][1] - uv[860][1]).powi(2)).sqrt();
        assert!((diagonal - 2_f64.sqrt()).abs() < 1e-3, "{diagonal}");
    }

    #[test]
    fn square_tube_without_mean_normal_is_unrolled() {
        let mesh = grid(16, 8, |_, _| 0.0);
        let corner = |x: f64| match (4.0 * x) as i32 {
            0 => [4.0 * x, 0.0],
            1 => [1.0, 4.0 * x - 1.0],
            2 => [3.0 - 4.0 * x, 1.0],
            _ => [0.0, 4.0 - 4.0 * x],
        };
        let tube: Vec<[f64; 3]> = mesh
            .vertices()
            .iter()
            .map(|p| [corner(p[0])[0], corner(p[0])[1], p[1]])
            .collect();
        let faces: Vec<[i64; 3]> = mesh.faces().iter().map(|f| f.map(i64::from)).collect();
        let tube = TriangleMesh::new(tube, &faces).unwrap();
        let uv = lscm(&tube).unwrap();
        let width = ((uv[0][0] - uv[16][0]).powi(2) + (uv[0][1] - uv[16][1]).powi(2)).sqrt();
        assert!((width - 4.0).abs() < 1e-3, "{width}");
    }

    #[test]
    fn closed_surface_is_refused() {
        assert!(matches!(
            lscm(&torus(12, 8, 0.3)),
            Err(Error::Topology { .. })
        ));
    }
}
