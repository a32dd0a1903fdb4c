use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray3};
use phaseatlas_core::raster;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::pool::detached;

/// Largest side of a texture; two buffers of it take 5 GiB.
const MAX_RESOLUTION: usize = 32768;

/// Face and count of every texel.
type Texels<'py> = (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<u8>>);

/// The face that covers each texel centre (-1 for none) and how many do, rows from the top.
#[pyfunction]
pub fn rasterize<'py>(
    py: Python<'py>,
    uv: PyReadonlyArray3<'_, f64>,
    resolution: usize,
) -> PyResult<Texels<'py>> {
    let view = uv.as_array();
    if view.shape()[1..] != [3, 2] {
        return Err(PyValueError::new_err(format!(
            "uv: shape {:?}, expected (m, 3, 2)",
            view.shape()
        )));
    }
    if !(1..=MAX_RESOLUTION).contains(&resolution) {
        return Err(PyValueError::new_err(format!(
            "resolution: {resolution} must be in 1..{MAX_RESOLUTION}"
        )));
    }
    let (corners, _) = uv.as_slice()?.as_chunks::<2>();
    let result = detached(py, || raster::rasterize(corners, resolution))?;
    let shape = [resolution, resolution];
    Ok((
        result.face.into_pyarray(py).reshape(shape)?,
        result.count.into_pyarray(py).reshape(shape)?,
    ))
}
