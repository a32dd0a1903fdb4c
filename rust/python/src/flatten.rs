use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use phaseatlas_core::flatten as core;
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, array2};
use crate::pool::detached;
use crate::to_python;

/// The mesh of a chart cut to a disk, the surface vertex of each of its vertices, the Euler
/// characteristic before the cut and the length of the cut.
type CutChart<'py> = (
    TriangleMesh,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray1<i64>>,
    i64,
    f64,
);

#[pyfunction]
pub fn cut_chart<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    faces: PyReadonlyArray1<'_, i64>,
) -> PyResult<CutChart<'py>> {
    let faces = faces.as_slice()?;
    let chart = detached(py, || core::ChartMesh::new(&mesh.core, faces))?.map_err(to_python)?;
    let triangles: Vec<[i64; 3]> = chart
        .mesh
        .faces()
        .iter()
        .map(|face| face.map(i64::from))
        .collect();
    let vertices: Vec<i64> = chart.vertices.iter().map(|&v| i64::from(v)).collect();
    Ok((
        TriangleMesh {
            core: Arc::new(chart.mesh),
        },
        array2(py, &triangles)?,
        PyArray1::from_vec(py, vertices),
        chart.euler_characteristic,
        chart.cut_length,
    ))
}

/// Least-squares conformal map of a disk, one point a vertex.
#[pyfunction]
pub fn lscm<'py>(py: Python<'py>, mesh: &TriangleMesh) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let uv = detached(py, || core::lscm(&mesh.core))?.map_err(to_python)?;
    array2(py, &uv)
}

/// Points and values of the vertices.
type ScaledMap<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Boundary-first map of a disk and its log scale factor, a point and a value a vertex.
#[pyfunction]
pub fn bff<'py>(py: Python<'py>, mesh: &TriangleMesh) -> PyResult<ScaledMap<'py>> {
    let flat = detached(py, || core::bff(&mesh.core))?.map_err(to_python)?;
    Ok((
        array2(py, &flat.uv)?,
        PyArray1::from_vec(py, flat.log_scale),
    ))
}
