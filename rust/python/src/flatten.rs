use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use phaseatlas_core::flatten as core;
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, array2};
use crate::pool::detached;
use crate::to_python;

/// Faces of a surface cut open to a disk.
#[pyclass(frozen, get_all, module = "phaseatlas._core")]
pub struct CutChart {
    /// The disk.
    mesh: Py<TriangleMesh>,
    /// Its faces, in its vertices.
    triangles: Py<PyArray2<i64>>,
    /// The surface vertex of each of its vertices.
    vertices: Py<PyArray1<i64>>,
    /// Euler characteristic before the cut.
    euler_characteristic: i64,
    /// Length of the cut.
    length: f64,
}

#[pyfunction]
pub fn cut_chart(
    py: Python<'_>,
    mesh: &TriangleMesh,
    faces: PyReadonlyArray1<'_, i64>,
) -> PyResult<CutChart> {
    let faces = faces.as_slice()?;
    let chart = detached(py, || core::ChartMesh::new(mesh.core(), faces))?.map_err(to_python)?;
    let triangles: Vec<[i64; 3]> = chart
        .mesh
        .faces()
        .iter()
        .map(|face| face.map(i64::from))
        .collect();
    let vertices: Vec<i64> = chart.vertices.iter().map(|&v| i64::from(v)).collect();
    Ok(CutChart {
        mesh: Py::new(py, TriangleMesh::new(chart.mesh))?,
        triangles: array2(py, &triangles)?.unbind(),
        vertices: PyArray1::from_vec(py, vertices).unbind(),
        euler_characteristic: chart.euler_characteristic,
        length: chart.cut_length,
    })
}

/// Least-squares conformal map of a disk, one point a vertex.
#[pyfunction]
pub fn lscm<'py>(py: Python<'py>, mesh: &TriangleMesh) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let uv = detached(py, || core::lscm(mesh.core()))?.map_err(to_python)?;
    array2(py, &uv)
}

/// A map of a disk to the plane.
#[pyclass(frozen, get_all, module = "phaseatlas._core")]
pub struct ScaledMap {
    /// A point a vertex.
    uv: Py<PyArray2<f64>>,
    /// Its log scale factor there.
    log_scale: Py<PyArray1<f64>>,
}

/// Boundary-first map of a disk.
#[pyfunction]
pub fn bff(py: Python<'_>, mesh: &TriangleMesh) -> PyResult<ScaledMap> {
    let flat = detached(py, || core::bff(mesh.core()))?.map_err(to_python)?;
    Ok(ScaledMap {
        uv: array2(py, &flat.uv)?.unbind(),
        log_scale: PyArray1::from_vec(py, flat.log_scale).unbind(),
    })
}
