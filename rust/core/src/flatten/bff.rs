//! Boundary-first flattening of a disk (Sawhney and Crane 2017) with the boundary kept in length.

use super::disk::boundary_of_disk;
use crate::error::{Error, Result};
use crate::linear::{Cholesky, Ordering};
use crate::mesh::{TriangleMesh, distance};
use crate::operators::{DirichletSystem, Stiffness};

/// A flattening and its log scale factor, one value a vertex.
#[derive(Debug)]
pub struct Bff {
    /// The map, one point a vertex.
    pub uv: Vec<[f64; 2]>,
    /// u of the flat metric e^{2 u} g, 0 on the boundary: the least distorted among the conformal
    /// ones (Springborn, Schroeder, Pinkall 2008).
    pub log_scale: Vec<f64>,
}

/// Flattens a disk by the conformal map whose scale is 1 on the boundary.
///
/// The Yamabe equation with u = 0 on the boundary gives the scale; its flux bends the boundary, whose
/// edges keep their length but for the least change that closes the curve; the curve is
/// extended harmonically to the inside.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::bff;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A square in space, folded along no edge, keeps its sides.
/// let corners = vec![[0.0; 3], [0.0, 3.0, 0.0], [0.0, 3.0, 3.0], [0.0, 0.0, 3.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let flat = bff(&square)?;
/// let side = (0..2).map(|k| flat.uv[1][k] - flat.uv[0][k]).map(|x| x * x).sum::<f64>().sqrt();
/// assert!((side - 3.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Topology`] for a mesh that is no disk, [`Error::NotPositiveDefinite`].
pub fn bff(mesh: &TriangleMesh) -> Result<Bff> {
    let boundary = boundary_of_disk(mesh)?;
    let n = mesh.n_vertices();
    let system = DirichletSystem::new(mesh, Ordering::MinimumDegree)?;
    let stiffness = Stiffness::new(mesh);
    let mut values = vec![0.0; system.len()];
    system.fill(mesh, &stiffness, &vec![0.0; n], &mut values);
    let mut cholesky = Cholesky::new(system.symbolic())?;
    cholesky.factor(&values)?;

    let mut log_scale: Vec<f64> = mesh
        .angle_defects()
        .iter()
        .zip(mesh.on_boundary())
        .map(|(k, &boundary)| if boundary { 0.0 } else { -k })
        .collect();
    cholesky.solve(&mut log_scale)?;

    let curve = flat_boundary(mesh, &stiffness, boundary, &log_scale)?;

    // Harmonic extension: S_II x_I = -S_IB x_B for both coordinates. The columns are 0 inside, so
    // that the whole row gives the right-hand side.
    let mut columns = vec![0.0; 2 * n];
    for axis in 0..2 {
        let column = &mut columns[axis * n..(axis + 1) * n];
        for (&v, point) in boundary.iter().zip(&curve) {
            column[v as usize] = point[axis];
        }
        let load: Vec<f64> = (0..n)
            .map(|i| {
                if mesh.on_boundary()[i] {
                    column[i]
                } else {
                    -stiffness.apply_row(mesh.adjacency(), column, i)
                }
            })
            .collect();
        column.copy_from_slice(&load);
    }
    cholesky.solve(&mut columns)?;
    Ok(Bff {
        uv: (0..n).map(|v| [columns[v], columns[n + v]]).collect(),
        log_scale,
    })
}

/// The boundary as a closed curve in the plane, vertex by vertex, of the curvature that the scale
/// prescribes.
fn flat_boundary(
    mesh: &TriangleMesh,
    stiffness: &Stiffness,
    boundary: &[u32],
    log_scale: &[f64],
) -> Result<Vec<[f64; 2]>> {
    let count = boundary.len();
    let position = |i: usize| mesh.vertices()[boundary[i % count] as usize];
    let lengths: Vec<f64> = (0..count)
        .map(|i| distance(position(i), position(i + 1)))
        .collect();
    let mut angle: f64 = 0.0;
    let mut tangents = Vec::with_capacity(count);
    for &v in boundary {
        let v = v as usize;
        // Turning at v, before the edge to the next vertex: exterior angle plus flux.
        angle += mesh.angle_defects()[v] + stiffness.apply_row(mesh.adjacency(), log_scale, v);
        tangents.push([angle.cos(), angle.sin()]);
    }
    // Least change, relative to the lengths, that closes the curve (equation 19 of the paper).
    let mut gap = [0.0; 2];
    let mut normal = [[0.0; 2]; 2];
    for (tangent, length) in tangents.iter().zip(&lengths) {
        for r in 0..2 {
            gap[r] += length * tangent[r];
            for c in 0..2 {
                normal[r][c] += length * tangent[r] * tangent[c];
            }
        }
    }
    let determinant = normal[0][0] * normal[1][1] - normal[0][1] * normal[1][0];
    let correction = [
        (normal[1][1] * gap[0] - normal[0][1] * gap[1]) / determinant,
        (normal[0][0] * gap[1] - normal[1][0] * gap[0]) / determinant,
    ];
    if !correction.iter().all(|c| c.is_finite()) {
        return Err(Error::Topology {
            argument: "mesh",
            reason: "the boundary cannot be closed in the plane".into(),
        });
    }
    let mut point = [0.0; 2];
    let mut curve = Vec::with_capacity(count);
    for (tangent, length) in tangents.iter().zip(&lengths) {
        curve.push(point);
        let change = 1.0 - correction[0] * tangent[0] - correction[1] * tangent[1];
        for axis in 0..2 {
            point[axis] += change * length * tangent[axis];
        }
    }
    Ok(curve)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn plane_is_kept() {
        let mesh = grid(12, 9, |_, _| 0.0);
        let flat = bff(&mesh).unwrap();
        assert!(flat.log_scale.iter().all(|u| u.abs() < 1e-12));
        for &[a, b] in mesh.edges() {
            let [p, q] = [a, b].map(|v| mesh.vertices()[v as usize]);
            let [s, t] = [a, b].map(|v| flat.uv[v as usize]);
            let length = ((s[0] - t[0]).powi(2) + (s[1] - t[1]).powi(2)).sqrt();
            assert!((length - distance(p, q)).abs() < 1e-10);
        }
    }

    #[test]
    fn dome_keeps_its_rim_and_shrinks_inside() {
        let mesh = grid(40, 40, |x, y| {
            (1.0 - (x - 0.5).powi(2) - (y - 0.5).powi(2)).sqrt()
        });
        let flat = bff(&mesh).unwrap();
        assert!(flat.log_scale.iter().all(|&u| u <= 0.0));
        assert!(flat.log_scale.iter().any(|&u| u < -0.05));
        let at = |v: u32| flat.uv[v as usize];
        for (&[a, b], half_edges) in mesh.edges().iter().zip(mesh.edge_half_edges()) {
            if half_edges[1] == crate::mesh::NONE {
                let [p, q] = [a, b].map(|v| mesh.vertices()[v as usize]);
                let length = (at(a)[0] - at(b)[0]).hypot(at(a)[1] - at(b)[1]);
                assert!((length / distance(p, q) - 1.0).abs() < 1e-3);
            }
        }
        let area: f64 = mesh
            .faces()
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(at);
                0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
            })
            .sum();
        let predicted: f64 = mesh
            .mass()
            .iter()
            .zip(&flat.log_scale)
            .map(|(m, u)| m * (2.0 * u).exp())
            .sum();
        assert!((area / predicted - 1.0).abs() < 1e-2, "{area} {predicted}");
    }
}
