use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray3};
use phaseatlas_core::packing as core;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::mesh::array2;
use crate::pool::detached;
use crate::raster::corners;
use crate::to_python;

/// Where packed pieces lie.
#[pyclass(frozen, get_all, module = "phaseatlas._core")]
pub struct Placement {
    /// Low corner of each turned piece, in cells, (k, 2).
    low: Py<PyArray2<i64>>,
    /// Counterclockwise quarter turns of each piece, (k,).
    turns: Py<PyArray1<i64>>,
}

/// Lays pieces at least `gap` cells apart into a small square.
///
/// Piece k has the triangles `starts[k]` to `starts[k + 1]` of `triangles`, (m, 3, 2), in cells, with
/// its low corner at the origin.
#[pyfunction]
pub fn pack(
    py: Python<'_>,
    triangles: PyReadonlyArray3<'_, f64>,
    starts: PyReadonlyArray1<'_, i64>,
    gap: f64,
    trials: usize,
) -> PyResult<Placement> {
    let corners = corners(&triangles)?;
    let starts = starts.as_slice()?;
    let pieces: Option<Vec<&[[f64; 2]]>> = starts
        .windows(2)
        .map(|pair| {
            let [from, to] = [pair[0], pair[1]].map(|start| usize::try_from(start).ok());
            corners.get(3 * from?..3 * to?)
        })
        .collect();
    let pieces = pieces.ok_or_else(|| {
        PyValueError::new_err(format!(
            "starts: must ascend from 0 to {}",
            corners.len() / 3
        ))
    })?;
    let placement = detached(py, || core::pack(&pieces, gap, trials))?.map_err(to_python)?;
    let low: Vec<[i64; 2]> = placement.low.iter().map(|p| p.map(|x| x as i64)).collect();
    let turns: Vec<i64> = placement.turns.iter().map(|&t| i64::from(t)).collect();
    Ok(Placement {
        low: array2(py, &low)?.unbind(),
        turns: PyArray1::from_vec(py, turns).unbind(),
    })
}
