use std::sync::Arc;

use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
};
use phaseatlas_core::mesh::NONE;
use phaseatlas_core::operators::Stiffness;
use phaseatlas_core::{Error, Surface, TriangleMesh as CoreMesh};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::pool::detached;
use crate::to_python;

/// Rows of an (n, K) array.
pub(crate) fn rows<const K: usize, T: Element + Copy>(
    argument: &str,
    array: &PyReadonlyArray2<'_, T>,
) -> PyResult<Vec<[T; K]>> {
    let view = array.as_array();
    if view.ncols() != K {
        return Err(PyValueError::new_err(format!(
            "{argument}: shape {:?} must be (n, {K})",
            view.shape()
        )));
    }
    Ok(view
        .rows()
        .into_iter()
        .map(|row| std::array::from_fn(|k| row[k]))
        .collect())
}

/// An (n, K) array of rows.
pub(crate) fn array2<'py, const K: usize, T: Element + Copy>(
    py: Python<'py>,
    rows: &[[T; K]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    rows.as_flattened()
        .to_vec()
        .into_pyarray(py)
        .reshape([rows.len(), K])
}

/// A validated triangle mesh and its operators.
#[pyclass(frozen, module = "phaseatlas._core")]
pub struct TriangleMesh {
    pub(crate) surface: Arc<Surface>,
}

impl TriangleMesh {
    pub(crate) fn new(mesh: CoreMesh) -> Self {
        Self {
            surface: Arc::new(Surface::new(mesh)),
        }
    }

    pub(crate) fn core(&self) -> &CoreMesh {
        self.surface.mesh()
    }
}

#[pymethods]
impl TriangleMesh {
    #[new]
    #[pyo3(signature = (vertices, faces, *, accepted = false, pieces = false, seam_costs = None))]
    fn from_arrays(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, i64>,
        accepted: bool,
        pieces: bool,
        seam_costs: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Self> {
        let vertices = rows::<3, f64>("vertices", &vertices)?;
        let faces = rows::<3, i64>("faces", &faces)?;
        let costs = seam_costs
            .map(|costs| rows::<3, f64>("seam_costs", &costs))
            .transpose()?;
        let build = match (accepted, pieces) {
            (_, true) => CoreMesh::pieces,
            (true, false) => CoreMesh::accepted,
            (false, false) => CoreMesh::new,
        };
        let core = detached(py, || match costs {
            Some(costs) => build(vertices, &faces)?.with_seam_costs(&costs),
            None => build(vertices, &faces),
        });
        let core = core?.map_err(to_python)?;
        Ok(Self::new(core))
    }

    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core().areas())
    }

    fn diameters<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core().diameters())
    }

    fn mass<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core().mass())
    }

    fn angle_defects<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core().angle_defects())
    }

    fn on_border<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, self.core().on_boundary())
    }

    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let edges: Vec<[i64; 2]> = self
            .core()
            .edges()
            .iter()
            .map(|edge| edge.map(i64::from))
            .collect();
        array2(py, &edges)
    }

    fn neighbours<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let neighbours: Vec<[i64; 3]> = self
            .core()
            .neighbours()
            .iter()
            .map(|across| across.map(|f| if f == NONE { -1 } else { i64::from(f) }))
            .collect();
        array2(py, &neighbours)
    }

    /// Off-diagonal values S_ij, one an edge.
    #[pyo3(signature = (weight=None))]
    fn edge_stiffness<'py>(
        &self,
        py: Python<'py>,
        weight: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let weight = weight.as_ref().map(|w| w.as_slice()).transpose()?;
        if let Some(weight) = weight
            && weight.len() != self.core().n_vertices()
        {
            return Err(to_python(Error::Length {
                argument: "weight",
                actual: weight.len(),
                expected: self.core().n_vertices(),
            }));
        }
        let stiffness = detached(py, || match weight {
            None => Stiffness::new(self.core()),
            Some(weight) => Stiffness::weighted(self.core(), weight, 0.0),
        })?;
        Ok(PyArray1::from_slice(py, stiffness.edge_values()))
    }

    #[getter]
    fn euler_characteristic(&self) -> i64 {
        self.core().euler_characteristic()
    }

    #[getter]
    fn genus(&self) -> i64 {
        self.core().genus()
    }

    #[getter]
    fn n_boundary_loops(&self) -> usize {
        self.core().n_boundary_loops()
    }

    #[getter]
    fn mean_edge_length(&self) -> f64 {
        self.core().mean_edge_length()
    }
}
