//! Sums of squared distances to planes and points (Garland and Heckbert 1997).

use crate::mesh::{cross, dot, subtract};

/// Weight of the squared distance to the vertices against that to the planes: on flat ground it makes
/// the faces regular, elsewhere it hardly counts. It also makes every least point unique.
const POINTS: f64 = 1e-3;
/// Weight of the squared distance to the border.
const BORDER: f64 = 10.0;

/// `x . matrix x - 2 vector . x + constant`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, xy, xz, yy, yz, zz.
    matrix: [f64; 6],
    vector: [f64; 3],
    constant: f64,
}

impl Quadric {
    /// Squared distance to a plane through `point`, its unit `normal` given.
    fn plane(point: [f64; 3], normal: [f64; 3], weight: f64) -> Self {
        let [x, y, z] = normal;
        let offset = dot(normal, point);
        Self {
            matrix: [x * x, x * y, x * z, y * y, y * z, z * z].map(|entry| weight * entry),
            vector: normal.map(|entry| weight * offset * entry),
            constant: weight * offset * offset,
        }
    }

    /// Squared distance to a point.
    fn point(point: [f64; 3], weight: f64) -> Self {
        Self {
            matrix: [weight, 0.0, 0.0, weight, 0.0, weight],
            vector: point.map(|entry| weight * entry),
            constant: weight * dot(point, point),
        }
    }

    /// A corner's share in a face: a third of its area.
    pub(super) fn corner(corners: [[f64; 3]; 3], at: [f64; 3]) -> Self {
        let normal = cross(
            subtract(corners[1], corners[0]),
            subtract(corners[2], corners[0]),
        );
        let length = dot(normal, normal).sqrt();
        let share = length / 6.0;
        let mut quadric = Self::point(at, POINTS * share);
        if length > 0.0 {
            quadric += Self::plane(corners[0], normal.map(|x| x / length), share);
        }
        quadric
    }

    /// An end's share in a border edge from `a` to `b` of a face with this third corner: the plane
    /// through the edge that is perpendicular to the face.
    pub(super) fn border(a: [f64; 3], b: [f64; 3], third: [f64; 3]) -> Self {
        let edge = subtract(b, a);
        let across = cross(edge, cross(edge, subtract(third, a)));
        let length = dot(across, across).sqrt();
        if length > 0.0 {
            Self::plane(a, across.map(|x| x / length), BORDER * dot(edge, edge))
        } else {
            Self::default()
        }
    }

    pub(super) fn value(&self, at: [f64; 3]) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.matrix;
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let product = rows.map(|row| dot(row, at));
        (dot(at, product) - 2.0 * dot(self.vector, at) + self.constant).max(0.0)
    }

    /// The point of least value, and the value there.
    pub(super) fn least(&self) -> ([f64; 3], f64) {
        let [xx, xy, xz, yy, yz, zz] = self.matrix;
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let cofactors = [
            cross(rows[1], rows[2]),
            cross(rows[2], rows[0]),
            cross(rows[0], rows[1]),
        ];
        let determinant = dot(rows[0], cofactors[0]);
        let point = [0, 1, 2].map(|axis| dot(cofactors[axis], self.vector) / determinant);
        (point, (self.constant - dot(self.vector, point)).max(0.0))
    }
}

impl std::ops::AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        for (a, b) in self.matrix.iter_mut().zip(other.matrix) {
            *a += b;
        }
        for (a, b) in self.vector.iter_mut().zip(other.vector) {
            *a += b;
        }
        self.constant += other.constant;
    }
}

impl std::ops::Add for Quadric {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_point_of_three_planes_is_where_they_meet() {
        let at = [1.0, 2.0, 3.0];
        let quadric = Quadric::plane(at, [1.0, 0.0, 0.0], 1.0)
            + Quadric::plane(at, [0.0, 1.0, 0.0], 2.0)
            + Quadric::plane(at, [0.0, 0.6, 0.8], 0.5);
        let (point, value) = quadric.least();
        assert!(
            (0..3).all(|k| (point[k] - at[k]).abs() < 1e-12),
            "{point:?}"
        );
        assert!(value < 1e-12, "{value}");
    }
}
