use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use phaseatlas_core::simplify as core;
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, array2};
use crate::pool::detached;

/// Vertices and faces of a simplified mesh, and the vertex that each has collapsed to.
type Simplified<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray1<u32>>,
);

#[pyfunction]
pub fn simplify<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    n_faces: usize,
) -> PyResult<Simplified<'py>> {
    let made = detached(py, || core::simplify(mesh.core(), n_faces))?;
    let faces: Vec<[i64; 3]> = made.faces.iter().map(|face| face.map(i64::from)).collect();
    Ok((
        array2(py, &made.vertices)?,
        array2(py, &faces)?,
        PyArray1::from_vec(py, made.collapsed_to),
    ))
}

/// The face of the simplified mesh for each face of the mesh.
#[pyfunction]
pub fn parents<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    simplified: &TriangleMesh,
    collapsed_to: PyReadonlyArray1<'_, u32>,
    normals: f64,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let collapsed_to = collapsed_to.as_slice()?;
    let found = detached(py, || {
        core::parents(mesh.core(), simplified.core(), collapsed_to, normals)
    })?;
    Ok(PyArray1::from_iter(py, found.into_iter().map(i64::from)))
}
