use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use phaseatlas_core::raster;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::pool::detached;
use crate::to_python;

/// Face and count of every texel.
type Texels<'py> = (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<u8>>);

/// The corners of the faces in a layout (m, 3, 2), one after the other.
pub(crate) fn corners<'a>(uv: &'a PyReadonlyArray3<'_, f64>) -> PyResult<&'a [[f64; 2]]> {
    if uv.shape()[1..] != [3, 2] {
        return Err(PyValueError::new_err(format!(
            "uv: shape {:?} must be (m, 3, 2)",
            uv.shape()
        )));
    }
    Ok(uv.as_slice()?.as_chunks().0)
}

/// The face that covers each texel centre (-1 for none) and how many do, rows from the top.
#[pyfunction]
pub fn rasterize<'py>(
    py: Python<'py>,
    uv: PyReadonlyArray3<'_, f64>,
    resolution: usize,
) -> PyResult<Texels<'py>> {
    let corners = corners(&uv)?;
    let result = detached(py, || raster::rasterize(corners, resolution))?.map_err(to_python)?;
    let shape = [resolution, resolution];
    Ok((
        result.face.into_pyarray(py).reshape(shape)?,
        result.count.into_pyarray(py).reshape(shape)?,
    ))
}

/// The face that is nearest to the viewer at each texel centre, -1 for none, rows from the top.
#[pyfunction]
pub fn nearest<'py>(
    py: Python<'py>,
    uv: PyReadonlyArray3<'_, f64>,
    heights: PyReadonlyArray2<'_, f64>,
    resolution: usize,
) -> PyResult<Bound<'py, PyArray2<i32>>> {
    let corners = corners(&uv)?;
    let heights = heights.as_slice()?.as_chunks().0;
    let face = detached(py, || raster::nearest(corners, heights, resolution))?;
    face.map_err(to_python)?
        .into_pyarray(py)
        .reshape([resolution, resolution])
}
