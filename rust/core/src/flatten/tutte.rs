//! A map that turns no face over, whatever the disk.

use std::f64::consts::TAU;
use std::sync::Arc;

use crate::error::Result;
use crate::linear::{Cholesky, Factorisation, Ordering, SymbolicFactorisation};
use crate::mesh::{TriangleMesh, distance};

/// Maps the boundary to a circle by its length and each inner vertex to the mean of its neighbours
/// (Tutte 1963): a bijection, but for rounding, and much distorted.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub(super) fn tutte(mesh: &TriangleMesh, boundary: &[u32]) -> Result<Vec<[f64; 2]>> {
    let n = mesh.n_vertices();
    let inner = |v: usize| !mesh.on_boundary()[v];
    let position = |i: usize| mesh.vertices()[boundary[i % boundary.len()] as usize];
    let lengths: Vec<f64> = (0..boundary.len())
        .map(|i| distance(position(i), position(i + 1)))
        .collect();
    let perimeter: f64 = lengths.iter().sum();
    let radius = perimeter / TAU;
    let mut columns = vec![0.0; 2 * n];
    let mut along = 0.0;
    for (&v, length) in boundary.iter().zip(&lengths) {
        let (sin, cos) = (TAU * along / perimeter).sin_cos();
        columns[v as usize] = radius * cos;
        columns[n + v as usize] = radius * sin;
        along += length;
    }
    let mut starts = vec![0];
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    let mut right = columns.clone();
    for v in 0..n {
        let around = || mesh.adjacency().around(v).map(|(w, _)| w);
        rows.push(v as u32);
        values.push(if inner(v) { around().len() as f64 } else { 1.0 });
        for w in around().filter(|&w| w > v && inner(v) && inner(w)) {
            rows.push(w as u32);
            values.push(-1.0);
        }
        starts.push(rows.len());
        if inner(v) {
            for part in [0, n] {
                right[part + v] = around()
                    .filter(|&w| !inner(w))
                    .map(|w| columns[part + w])
                    .sum();
            }
        }
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
    Ok((0..n).map(|v| [right[v], right[n + v]]).collect())
}
