//! A map of a part of a mesh, extended to the rest.

use std::sync::Arc;

use crate::error::{Error, Result, check_length};
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::TriangleMesh;

/// Shift of the conformal energy, which is barely definite, relative to its largest diagonal entry.
const SHIFT: f64 = 1e-10;

/// Extends a map of the first vertices of a mesh, which stay where they are, to all vertices: the
/// extension of least conformal energy, over the faces that have another vertex. It may turn faces
/// over.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::extend;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [3.0, 0.0, 0.0], [3.0, 3.0, 0.0], [0.0, 3.0, 0.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let uv = extend(&square, &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])?;
/// assert!((uv[3][0] - 0.0).abs() < 1e-6 && (uv[3][1] - 1.0).abs() < 1e-6);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Length`] for more points than vertices, [`Error::NotPositiveDefinite`] where rounding
/// spoils the factorisation.
pub fn extend(mesh: &TriangleMesh, held: &[[f64; 2]]) -> Result<Vec<[f64; 2]>> {
    let (n, first) = (mesh.n_vertices(), held.len());
    if first > n {
        check_length("uv", first, n)?;
    }
    let free = n - first;
    let mut uv = held.to_vec();
    uv.resize(n, [0.0; 2]);
    if free == 0 {
        return Ok(uv);
    }
    // Unknown 2 (v - first) + axis; entries of the lower triangle as (column, row, value).
    let unknown = |v: u32, axis: usize| (v as usize).checked_sub(first).map(|v| 2 * v + axis);
    let mut entries: Vec<(usize, usize, f64)> = Vec::new();
    let mut right = vec![0.0; 2 * free];
    let mut add = |[v, a]: [usize; 2], [w, b]: [usize; 2], value: f64| match (
        unknown(v as u32, a),
        unknown(w as u32, b),
    ) {
        (Some(i), Some(j)) if i >= j => entries.push((j, i, value)),
        (Some(i), None) => right[i] -= value * uv[w][b],
        _ => (),
    };
    for (face, half_cotangents) in mesh.faces().iter().zip(mesh.half_cotangents()) {
        if face.iter().all(|&v| (v as usize) < first) {
            continue;
        }
        for k in 0..3 {
            let (v, w) = (face[k] as usize, face[(k + 1) % 3] as usize);
            for axis in 0..2 {
                let c = half_cotangents[k];
                add([v, axis], [v, axis], c);
                add([w, axis], [w, axis], c);
                add([v, axis], [w, axis], -c);
                add([w, axis], [v, axis], -c);
            }
            // Twice the area is the sum of x_v y_w - x_w y_v over the sides.
            add([v, 0], [w, 1], -0.5);
            add([w, 1], [v, 0], -0.5);
            add([w, 0], [v, 1], 0.5);
            add([v, 1], [w, 0], 0.5);
        }
    }
    let largest = entries
        .iter()
        .filter(|entry| entry.0 == entry.1)
        .map(|entry| entry.2)
        .fold(0.0, f64::max);
    entries.extend((0..2 * free).map(|i| (i, i, SHIFT * largest)));
    entries.sort_by_key(|&(column, row, _)| (column, row));
    let mut starts = vec![0_usize; 2 * free + 1];
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for group in entries.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        rows.push(group[0].1 as u32);
        values.push(group.iter().map(|entry| entry.2).sum::<f64>());
        starts[group[0].0 + 1] = rows.len();
    }
    let symbolic = SymbolicFactorisation::new(
        &starts,
        &rows,
        Ordering::MinimumDegree,
        Factorisation::Automatic,
    )?;
    let mut cholesky = Cholesky::new(Arc::new(symbolic))?;
    cholesky.factor(&values)?;
    cholesky.solve(&mut right)?;
    if !right.iter().all(|x| x.is_finite()) {
        return Err(Error::Topology {
            argument: "mesh",
            reason: "the map cannot be extended: the numbers grow too large".into(),
        });
    }
    for (point, pair) in uv[first..].iter_mut().zip(right.as_chunks().0) {
        *point = *pair;
    }
    Ok(uv)
}
