use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use phaseatlas_core::packing::{self, Gap};
use pyo3::prelude::*;

use crate::mesh::rows;
use crate::pool::detached;
use crate::to_python;

/// Corners of triangles (m, 3, 2), laid into the unit square piece by piece.
///
/// The padding is a share of the side, or a length in the units of the points.
#[pyfunction]
#[pyo3(signature = (points, triangles, piece, padding, *, as_length = false))]
pub fn pack<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'_, f64>,
    triangles: PyReadonlyArray2<'_, i64>,
    piece: PyReadonlyArray1<'_, i64>,
    padding: f64,
    as_length: bool,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (points, triangles) = (rows("points", &points)?, rows("triangles", &triangles)?);
    let piece = piece.as_slice()?;
    let padding = if as_length {
        Gap::Length(padding)
    } else {
        Gap::Share(padding)
    };
    let uv =
        detached(py, || packing::pack(&points, &triangles, piece, padding))?.map_err(to_python)?;
    uv.as_flattened()
        .as_flattened()
        .to_vec()
        .into_pyarray(py)
        .reshape([uv.len(), 3, 2])
}

/// Largest share of the side that `pack` takes as padding of so many pieces.
#[pyfunction]
pub fn most_padding(count: usize) -> f64 {
    packing::most_padding(count)
}
