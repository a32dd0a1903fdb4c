use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use phaseatlas_core::mesh::NONE;
use phaseatlas_core::repair;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::mesh::{array2, rows};
use crate::pool::detached;
use crate::to_python;

/// A manifold made of polygons, and where it comes from.
#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Repair {
    core: repair::Repaired,
}

fn indices(values: impl Iterator<Item = u32>) -> Vec<i64> {
    values
        .map(|v| if v == NONE { -1 } else { i64::from(v) })
        .collect()
}

fn triples(
    py: Python<'_>,
    rows: impl Iterator<Item = [u32; 3]>,
) -> PyResult<Bound<'_, PyArray2<i64>>> {
    let rows: Vec<[i64; 3]> = rows.map(|row| row.map(i64::from)).collect();
    array2(py, &rows)
}

#[pymethods]
impl Repair {
    #[new]
    fn new(
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f64>,
        corners: PyReadonlyArray1<'_, i64>,
        sizes: Option<PyReadonlyArray1<'_, i64>>,
        weld: f64,
    ) -> PyResult<Self> {
        let positions = rows::<3, f64>("positions", &positions)?;
        let corners = corners.as_slice()?;
        let sizes = sizes.as_ref().map(|s| s.as_slice()).transpose()?;
        let core = detached(py, || repair::repair(&positions, corners, sizes, weld))?
            .map_err(to_python)?;
        Ok(Self { core })
    }

    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, &self.core.vertices)
    }

    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        triples(py, self.core.faces.iter().copied())
    }

    fn source_vertex<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, indices(self.core.source_vertex.iter().copied()))
    }

    fn polygon<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, indices(self.core.polygon.iter().copied()))
    }

    fn corner<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        triples(py, self.core.corner.iter().copied())
    }

    fn component<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, indices(self.core.component.iter().copied()))
    }

    fn flipped<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, &self.core.flipped)
    }

    fn inner<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        array2(py, &self.core.inner)
    }

    fn aside_polygon<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, indices(self.core.aside.iter().map(|t| t.polygon)))
    }

    fn aside_corner<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        triples(py, self.core.aside.iter().map(|t| t.corner))
    }

    fn aside_host<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, indices(self.core.aside.iter().map(|t| t.host)))
    }

    /// Barycentric coordinates in the host, (k, 9): three for each corner.
    fn aside_weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let weights: Vec<f64> = self
            .core
            .aside
            .iter()
            .flat_map(|t| t.weights.as_flattened().to_vec())
            .collect();
        PyArray1::from_vec(py, weights).reshape([self.core.aside.len(), 9])
    }

    fn aside_twin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_vec(py, self.core.aside.iter().map(|t| t.twin).collect())
    }

    /// How often each defect was found, by name.
    fn defects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let defects = &self.core.defects;
        let counts = PyDict::new(py);
        for (name, count) in [
            ("components", defects.components),
            ("boundary_loops", defects.boundary_loops),
            ("welded_vertices", defects.welded_vertices),
            ("isolated_vertices", defects.isolated_vertices),
            ("degenerate_faces", defects.degenerate_faces),
            ("duplicate_faces", defects.duplicate_faces),
            ("opposite_faces", defects.opposite_faces),
            ("non_manifold_edges", defects.non_manifold_edges),
            ("non_manifold_vertices", defects.non_manifold_vertices),
            ("flipped_faces", defects.flipped_faces),
            ("cut_edges", defects.cut_edges),
            ("opened_edges", defects.opened_edges),
        ] {
            counts.set_item(name, count)?;
        }
        Ok(counts)
    }
}

/// Polygon and corners of every triangle.
type Triangles<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<i64>>);

/// Polygons cut into triangles: the polygon of each, and its places in `corners`.
#[pyfunction]
pub fn triangulate<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'_, f64>,
    corners: PyReadonlyArray1<'_, i64>,
    sizes: PyReadonlyArray1<'_, i64>,
) -> PyResult<Triangles<'py>> {
    let positions = rows::<3, f64>("positions", &positions)?;
    let (corners, sizes) = (corners.as_slice()?, sizes.as_slice()?);
    let (polygon, triangles) =
        detached(py, || repair::triangulate(&positions, corners, sizes))?.map_err(to_python)?;
    Ok((
        PyArray1::from_vec(py, indices(polygon.into_iter())),
        triples(py, triangles.into_iter())?,
    ))
}
