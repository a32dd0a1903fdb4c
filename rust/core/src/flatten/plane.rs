//! Pieces of a plane.

use crate::mesh::TriangleMesh;

/// Squared sine of the angle between normals above which faces do not lie in one plane: rounding.
const COPLANAR: f64 = 1e-14;

type Vector = [f64; 3];

/// Whether all faces have one normal, to rounding.
pub(super) fn is_planar(mesh: &TriangleMesh) -> bool {
    let first = normal(mesh, 0);
    (0..mesh.n_faces()).all(|f| {
        let other = normal(mesh, f);
        let sine = cross(first, other);
        dot(first, other) > 0.0 && dot(sine, sine) < COPLANAR
    })
}

/// The vertices in coordinates of the plane that the largest face lies in.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::in_plane;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [0.0, 3.0, 0.0], [0.0, 3.0, 4.0]];
/// let uv = in_plane(&TriangleMesh::new(corners, &[[0, 1, 2]])?);
/// assert_eq!(uv, [[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn in_plane(mesh: &TriangleMesh) -> Vec<[f64; 2]> {
    let areas = mesh.areas();
    let largest = (1..areas.len()).fold(0, |f, g| if areas[g] > areas[f] { g } else { f });
    let [a, b, _] = mesh.faces()[largest].map(|v| mesh.vertices()[v as usize]);
    let x = unit(subtract(b, a));
    let y = cross(normal(mesh, largest), x);
    mesh.vertices()
        .iter()
        .map(|&p| {
            let from = subtract(p, a);
            [dot(from, x), dot(from, y)]
        })
        .collect()
}

fn normal(mesh: &TriangleMesh, f: usize) -> Vector {
    let [a, b, c] = mesh.faces()[f].map(|v| mesh.vertices()[v as usize]);
    unit(cross(unit(subtract(b, a)), unit(subtract(c, a))))
}

fn unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
