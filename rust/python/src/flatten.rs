use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use phaseatlas_core::flatten as core;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, array2, rows};
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

impl CutChart {
    fn new(py: Python<'_>, chart: core::ChartMesh) -> PyResult<Self> {
        Ok(Self {
            triangles: triangles(py, &chart.mesh)?,
            mesh: Py::new(py, TriangleMesh::new(chart.mesh))?,
            vertices: PyArray1::from_iter(py, chart.vertices.iter().map(|&v| i64::from(v)))
                .unbind(),
            euler_characteristic: chart.euler_characteristic,
            length: chart.cut_length,
        })
    }
}

#[pyfunction]
pub fn cut_chart(
    py: Python<'_>,
    mesh: &TriangleMesh,
    faces: PyReadonlyArray1<'_, i64>,
) -> PyResult<CutChart> {
    let faces = faces.as_slice()?;
    let chart = detached(py, || core::ChartMesh::new(mesh.core(), faces))?.map_err(to_python)?;
    CutChart::new(py, chart)
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

/// Map of a disk that keeps lengths best and is a bijection.
#[pyfunction]
pub fn isometric<'py>(py: Python<'py>, mesh: &TriangleMesh) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let uv = detached(py, || core::isometric(mesh.core()))?.map_err(to_python)?;
    array2(py, &uv)
}

/// Energy of a map and its gradient, a row a vertex.
#[pyfunction]
pub fn symmetric_dirichlet<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    uv: PyReadonlyArray2<'_, f64>,
) -> PyResult<(f64, Bound<'py, PyArray2<f64>>)> {
    let uv = rows("uv", &uv)?;
    let (energy, gradient) =
        detached(py, || core::symmetric_dirichlet(mesh.core(), &uv))?.map_err(to_python)?;
    Ok((energy, array2(py, &gradient)?))
}

/// The vertices of a mesh in coordinates of its plane.
#[pyfunction]
pub fn in_plane<'py>(py: Python<'py>, mesh: &TriangleMesh) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array2(py, &core::in_plane(mesh.core()))
}

/// The map of the first vertices of a mesh, extended to all.
#[pyfunction]
pub fn extend<'py>(
    py: Python<'py>,
    mesh: &TriangleMesh,
    uv: PyReadonlyArray2<'_, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let uv = rows("uv", &uv)?;
    let uv = detached(py, || core::extend(mesh.core(), &uv))?.map_err(to_python)?;
    array2(py, &uv)
}

/// Faces turned over, whether the boundary crosses itself, faces too thin to be judged.
#[pyfunction]
pub fn faults(
    py: Python<'_>,
    triangles: PyReadonlyArray2<'_, i64>,
    uv: PyReadonlyArray2<'_, f64>,
    thin: f64,
) -> PyResult<(usize, bool, usize)> {
    let uv = rows("uv", &uv)?;
    let faces = rows::<3, i64>("triangles", &triangles)?
        .iter()
        .map(|face| {
            let vertex = |v: i64| u32::try_from(v).ok().filter(|&v| (v as usize) < uv.len());
            match face.map(vertex) {
                [Some(a), Some(b), Some(c)] => Ok([a, b, c]),
                _ => Err(PyValueError::new_err(format!(
                    "triangles: {face:?} must be in 0..{}",
                    uv.len()
                ))),
            }
        })
        .collect::<PyResult<Vec<_>>>()?;
    let found = detached(py, || core::faults(&faces, &uv, thin))?;
    Ok((found.flips, found.crosses, found.thin))
}

/// A chart alone, and with faces around it attached.
#[pyclass(frozen, get_all, module = "phaseatlas._core")]
pub struct GrownChart {
    /// The chart, which a flat piece with holes is as it is.
    chart: Py<CutChart>,
    /// Both; the vertices and faces of the chart come first.
    mesh: Py<TriangleMesh>,
    triangles: Py<PyArray2<i64>>,
    /// The surface vertex of each vertex.
    vertices: Py<PyArray1<i64>>,
    /// The surface face of each face.
    faces: Py<PyArray1<i64>>,
}

#[pyfunction]
pub fn grow_chart(
    py: Python<'_>,
    mesh: &TriangleMesh,
    faces: PyReadonlyArray1<'_, i64>,
    around: PyReadonlyArray1<'_, i64>,
) -> PyResult<GrownChart> {
    let (faces, around) = (faces.as_slice()?, around.as_slice()?);
    let (chart, grown) = detached(py, || {
        let chart = core::ChartMesh::with_flat_holes(mesh.core(), faces)?;
        let grown = core::grow(mesh.core(), &chart, faces, around)?;
        Ok((chart, grown))
    })?
    .map_err(to_python)?;
    Ok(GrownChart {
        chart: Py::new(py, CutChart::new(py, chart)?)?,
        triangles: triangles(py, &grown.mesh)?,
        mesh: Py::new(py, TriangleMesh::new(grown.mesh))?,
        vertices: PyArray1::from_iter(py, grown.vertices.iter().map(|&v| i64::from(v))).unbind(),
        faces: PyArray1::from_vec(py, grown.faces).unbind(),
    })
}

fn triangles(py: Python<'_>, mesh: &phaseatlas_core::TriangleMesh) -> PyResult<Py<PyArray2<i64>>> {
    let faces: Vec<[i64; 3]> = mesh
        .faces()
        .iter()
        .map(|face| face.map(i64::from))
        .collect();
    Ok(array2(py, &faces)?.unbind())
}

/// A surface cut open along the seams of a layout.
#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Layout {
    layout: core::Layout,
}

#[pymethods]
impl Layout {
    /// Charts meet where coordinates, three rows a face, differ by at most `tolerance`.
    #[new]
    fn from_arrays(
        py: Python<'_>,
        mesh: &TriangleMesh,
        uv: PyReadonlyArray2<'_, f64>,
        tolerance: f64,
    ) -> PyResult<Self> {
        let uv = rows::<2, f64>("uv", &uv)?;
        let layout = detached(py, || {
            core::Layout::new(mesh.core(), uv.as_chunks().0, tolerance)
        })?
        .map_err(to_python)?;
        Ok(Self { layout })
    }

    #[getter]
    fn n_charts(&self) -> usize {
        self.layout.n_charts
    }

    #[getter]
    fn n_vertices(&self) -> usize {
        self.layout.n_vertices
    }

    /// Chart of each face.
    fn charts<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.layout.charts.iter().map(|&c| i64::from(c)))
    }

    /// Vertex of the cut surface at each corner.
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let corners = self.layout.corners.iter();
        array2(
            py,
            &corners.map(|face| face.map(i64::from)).collect::<Vec<_>>(),
        )
    }

    /// Whether each edge of each face lies within a chart.
    fn joined<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        array2(py, &self.layout.joined)
    }

    /// Log scale of each chart at the vertices of the cut surface.
    fn log_scales<'py>(
        &self,
        py: Python<'py>,
        mesh: &TriangleMesh,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let scales = detached(py, || self.layout.log_scales(mesh.core()))?;
        Ok(PyArray1::from_vec(py, scales.map_err(to_python)?))
    }

    /// Number of charts whose boundary crosses itself.
    fn crossing(
        &self,
        py: Python<'_>,
        uv: PyReadonlyArray2<'_, f64>,
        thin: f64,
    ) -> PyResult<usize> {
        let uv = rows::<2, f64>("uv", &uv)?;
        detached(py, || self.layout.crossing(uv.as_chunks().0, thin))?.map_err(to_python)
    }
}
