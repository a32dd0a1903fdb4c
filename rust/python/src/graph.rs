use numpy::{PyArray1, PyReadonlyArray1};
use phaseatlas_core::{Error, graph};
use pyo3::prelude::*;

use crate::mesh::TriangleMesh;
use crate::pool::detached;
use crate::to_python;

/// Component of every face; two neighbours connect where their labels agree.
#[pyfunction]
pub fn label_components<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    labels: PyReadonlyArray1<'_, i64>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let labels = labels.as_slice()?;
    if labels.len() != mesh.core().n_faces() {
        return Err(to_python(Error::Length {
            argument: "labels",
            actual: labels.len(),
            expected: mesh.core().n_faces(),
        }));
    }
    let components = detached(py, || graph::label_components(mesh.core(), labels))?;
    let labels: Vec<i64> = components.labels.into_iter().map(i64::from).collect();
    Ok(PyArray1::from_vec(py, labels))
}
