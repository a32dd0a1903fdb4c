use numpy::{PyArray1, PyArray2};
use phaseatlas_core::obj;
use pyo3::prelude::*;

use crate::mesh::array2;
use crate::to_python;

/// Positions (n, 3), corners (k,) and ends (p,) of the polygons of an OBJ file.
type Polygons<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
);

/// Positions, and corners of all polygons with the place where each polygon ends.
#[pyfunction]
pub fn parse_obj<'py>(py: Python<'py>, text: &[u8]) -> PyResult<Polygons<'py>> {
    let polygons = py.detach(|| obj::parse(text)).map_err(to_python)?;
    Ok((
        array2(py, &polygons.positions)?,
        PyArray1::from_vec(py, polygons.corners),
        PyArray1::from_vec(py, polygons.ends),
    ))
}
