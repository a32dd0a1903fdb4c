//! Maps whose few faces that are turned over are turned back.

use super::polygon::{Point, turn};
use crate::mesh::TriangleMesh;

/// Rings of vertices around faces that are turned over which move, first and last.
const RINGS: std::ops::Range<usize> = 1..9;
/// Averagings of these vertices, for each ring.
const AVERAGINGS: usize = 40;
/// Part of the faces up to which it is tried.
const FEW: f64 = 0.02;

/// Turns the faces of a map back that are turned over, if they are few: the vertices around move to
/// the mean of their neighbours, as in the map of Tutte (1963), in wider and wider patches. [`None`]
/// where faces are left.
pub(super) fn mended(mesh: &TriangleMesh, mut uv: Vec<Point>) -> Option<Vec<Point>> {
    if !uv.iter().flatten().all(|x| x.is_finite()) {
        return None;
    }
    let most = (FEW * mesh.n_faces() as f64) as usize;
    for rings in RINGS {
        let wrong: Vec<[u32; 3]> = mesh
            .faces()
            .iter()
            .copied()
            .filter(|face| {
                let [a, b, c] = face.map(|v| uv[v as usize]);
                turn(a, b, c) <= 0.0
            })
            .collect();
        if wrong.is_empty() {
            return Some(uv);
        }
        if wrong.len() > most {
            return None;
        }
        let mut patch: Vec<u32> = wrong.into_flattened();
        for _ in 0..rings {
            let around = patch
                .iter()
                .flat_map(|&v| mesh.adjacency().around(v as usize));
            let around: Vec<u32> = around.map(|(w, _)| w as u32).collect();
            patch.extend(around);
            patch.sort_unstable();
            patch.dedup();
        }
        patch.retain(|&v| !mesh.on_boundary()[v as usize]);
        for _ in 0..AVERAGINGS * rings {
            for &v in &patch {
                let around = mesh.adjacency().around(v as usize);
                let count = around.len() as f64;
                let sum = around.fold([0.0; 2], |[x, y], (w, _)| [x + uv[w][0], y + uv[w][1]]);
                uv[v as usize] = sum.map(|x| x / count);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn faces_that_are_turned_over_are_turned_back() {
        let mesh = grid(30, 30, |_, _| 0.0);
        let flat: Vec<Point> = mesh.vertices().iter().map(|p| [p[0], p[1]]).collect();
        let mut uv = flat.clone();
        uv[31 * 15 + 15] = [0.56, 0.53];
        uv[31 * 7 + 4] = [0.1, 0.1];
        let found = mended(&mesh, uv).unwrap();
        let upright = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| found[v as usize]);
            turn(a, b, c) > 0.0
        };
        assert!(mesh.faces().iter().all(upright));
        // What is far from them stays.
        assert_eq!(found[31 * 25 + 25], flat[31 * 25 + 25]);
        let mirrored = flat.iter().map(|p| [-p[0], p[1]]).collect();
        assert!(mended(&mesh, mirrored).is_none());
    }
}
