//! The symmetric Dirichlet energy of a map of a mesh to the plane.

use super::polygon::Point;
use crate::mesh::{TriangleMesh, distance};

pub(super) type Matrix2 = [[f64; 2]; 2];

/// The faces of a mesh as they lie in their own planes.
pub(super) struct Elements {
    pub faces: Vec<[u32; 3]>,
    /// Gradients of the hat functions of the three corners.
    gradients: Vec<[Point; 3]>,
    /// Areas, with sum 1.
    weights: Vec<f64>,
}

/// A face's share of the first and second derivatives.
pub(super) struct Derivatives {
    pub gradient: [Point; 3],
    /// Blocks (i, j) of the Hessian, made positive semidefinite.
    pub hessian: [[Matrix2; 3]; 3],
}

impl Elements {
    /// Takes lengths relative to `unit`.
    pub fn new(mesh: &TriangleMesh, unit: f64) -> Self {
        let gradients = mesh
            .faces()
            .iter()
            .zip(mesh.areas())
            .map(|(face, area)| {
                let p = face.map(|v| mesh.vertices()[v as usize]);
                let base = distance(p[0], p[1]) / unit;
                let height = 2.0 * area / (unit * unit) / base;
                let along = (0..3)
                    .map(|axis| (p[1][axis] - p[0][axis]) * (p[2][axis] - p[0][axis]))
                    .sum::<f64>()
                    / (unit * unit)
                    / base;
                let second = [1.0 / base, -along / (base * height)];
                let third = [0.0, 1.0 / height];
                [[-second[0], -second[1] - third[1]], second, third]
            })
            .collect();
        let total = mesh.area();
        Self {
            faces: mesh.faces().to_vec(),
            gradients,
            weights: mesh.areas().iter().map(|area| area / total).collect(),
        }
    }

    fn jacobian(&self, f: usize, uv: &[Point]) -> Matrix2 {
        let mut jacobian = [[0.0; 2]; 2];
        for (&v, gradient) in self.faces[f].iter().zip(&self.gradients[f]) {
            for r in 0..2 {
                for c in 0..2 {
                    jacobian[r][c] += uv[v as usize][r] * gradient[c];
                }
            }
        }
        jacobian
    }

    /// Means over the area of the squared singular values and of their inverses.
    pub fn parts(&self, uv: &[Point]) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (f, weight) in self.weights.iter().enumerate() {
            let [[a, b], [c, d]] = self.jacobian(f, uv);
            let determinant = a * d - b * c;
            let square = a * a + b * b + c * c + d * d;
            if !(determinant > 0.0) {
                return [square, f64::INFINITY];
            }
            sums[0] += weight * square;
            sums[1] += weight * square / (determinant * determinant);
        }
        sums
    }

    /// Mean over the area of s1^2 + s2^2 + s1^-2 + s2^-2, with the singular values of the map.
    pub fn energy(&self, uv: &[Point]) -> f64 {
        let [squares, inverses] = self.parts(uv);
        squares + inverses
    }

    /// Derivatives of a face's share of the energy, by the eigenvectors of its Hessian in the
    /// Jacobian (Smith, de Goes and Kim 2019).
    pub fn derivatives(&self, f: usize, uv: &[Point]) -> Derivatives {
        let jacobian = self.jacobian(f, uv);
        let (u, [s, t], v) = singular_values(jacobian);
        let slope = |s: f64| 2.0 * (s - 1.0 / (s * s * s));
        let curvature = |s: f64| 2.0 + 6.0 / (s * s * s * s);
        let product = s * t;
        let cube = product * product * product;
        let half = 0.5_f64.sqrt();
        let modes: [(f64, Matrix2); 4] = [
            (curvature(s), [[1.0, 0.0], [0.0, 0.0]]),
            (curvature(t), [[0.0, 0.0], [0.0, 1.0]]),
            (
                2.0 - 2.0 * (s * s - product + t * t) / cube,
                [[0.0, -half], [half, 0.0]],
            ),
            (
                2.0 + 2.0 * (s * s + product + t * t) / cube,
                [[0.0, half], [half, 0.0]],
            ),
        ];
        let weight = self.weights[f];
        let gradients = self.gradients[f];
        let stress = between(u, [[slope(s), 0.0], [0.0, slope(t)]], v);
        let gradient = gradients.map(|g| apply(stress, g).map(|x| weight * x));
        let mut hessian = [[[[0.0; 2]; 2]; 3]; 3];
        for (value, mode) in modes {
            if !(value > 0.0) {
                continue;
            }
            let mode = between(u, mode, v);
            let moved = gradients.map(|g| apply(mode, g));
            for i in 0..3 {
                for j in 0..3 {
                    for r in 0..2 {
                        for c in 0..2 {
                            hessian[i][j][r][c] += weight * value * moved[i][r] * moved[j][c];
                        }
                    }
                }
            }
        }
        Derivatives { gradient, hessian }
    }
}

/// u m v.
fn between(u: Matrix2, m: Matrix2, v: Matrix2) -> Matrix2 {
    multiply(multiply(u, m), v)
}

fn multiply(a: Matrix2, b: Matrix2) -> Matrix2 {
    [0, 1].map(|r| [0, 1].map(|c| a[r][0] * b[0][c] + a[r][1] * b[1][c]))
}

fn apply(m: Matrix2, x: Point) -> Point {
    [0, 1].map(|r| m[r][0] * x[0] + m[r][1] * x[1])
}

/// Rotations u, v and values s >= t with m = u diag(s, t) v; t has the sign of the determinant.
fn singular_values([[a, b], [c, d]]: Matrix2) -> (Matrix2, [f64; 2], Matrix2) {
    let (e, f, g, h) = (0.5 * (a + d), 0.5 * (a - d), 0.5 * (c + b), 0.5 * (c - b));
    let (q, r) = (e.hypot(h), f.hypot(g));
    let (sum, difference) = (h.atan2(e), g.atan2(f));
    let rotation = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        [[cos, -sin], [sin, cos]]
    };
    let s = q + r;
    // The difference q - r would lose the digits of a small value.
    let t = (a * d - b * c) / s;
    let u = rotation(0.5 * (sum + difference));
    let v = rotation(0.5 * (sum - difference));
    (u, [s, t], v)
}

/// The energy of a map, and its gradient in the point of each vertex.
///
/// The energy is the mean over the area of s1^2 + s2^2 + 1 / s1^2 + 1 / s2^2, where s1 and s2 are
/// the singular values of the map: 4 where lengths are kept, infinite where a face is turned over.
///
/// # Errors
/// [`crate::Error::Length`] for points that are not one a vertex.
pub fn symmetric_dirichlet(
    mesh: &TriangleMesh,
    uv: &[Point],
) -> crate::error::Result<(f64, Vec<Point>)> {
    crate::error::check_length("uv", uv.len(), mesh.n_vertices())?;
    let elements = Elements::new(mesh, 1.0);
    let mut gradient = vec![[0.0; 2]; uv.len()];
    for (f, face) in elements.faces.iter().enumerate() {
        let derivatives = elements.derivatives(f, uv);
        for (&v, slope) in face.iter().zip(derivatives.gradient) {
            for axis in 0..2 {
                gradient[v as usize][axis] += slope[axis];
            }
        }
    }
    Ok((elements.energy(uv), gradient))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_compose() {
        for m in [
            [[1.0, 0.0], [0.0, 1.0]],
            [[0.3, -2.0], [1.0, 0.7]],
            [[1.0, 2.0], [2.0, 4.0 + 1e-9]],
        ] {
            let (u, [s, t], v) = singular_values(m);
            let again = between(u, [[s, 0.0], [0.0, t]], v);
            for r in 0..2 {
                for c in 0..2 {
                    assert!((again[r][c] - m[r][c]).abs() < 1e-14, "{again:?} {m:?}");
                }
            }
            assert!(s >= t && t > 0.0);
        }
    }

    #[test]
    fn hessian_is_that_of_differences_where_it_is_definite() {
        let mesh = TriangleMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.2, 0.9, 0.4]],
            &[[0, 1, 2]],
        )
        .unwrap();
        let elements = Elements::new(&mesh, 1.0);
        let uv = [[0.1, 0.2], [2.3, 0.4], [0.5, 2.1]];
        let at = elements.derivatives(0, &uv);
        let step = 1e-5;
        for j in 0..3 {
            for c in 0..2 {
                let side = |sign: f64| {
                    let mut moved = uv;
                    moved[j][c] += sign * step;
                    elements.derivatives(0, &moved).gradient
                };
                let (up, down) = (side(1.0), side(-1.0));
                for i in 0..3 {
                    for r in 0..2 {
                        let slope = (up[i][r] - down[i][r]) / (2.0 * step);
                        assert!((slope - at.hessian[i][j][r][c]).abs() < 1e-7);
                    }
                }
            }
        }
    }
}
