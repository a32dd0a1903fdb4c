use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use phaseatlas_core::operators as core;
use pyo3::prelude::*;

use crate::mesh::TriangleMesh;
use crate::pool::detached;
use crate::{filled, to_python};

/// The factored system that spreads labels.
#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Screened {
    surface: Arc<phaseatlas_core::Surface>,
    core: Mutex<core::Screened>,
}

#[pymethods]
impl Screened {
    /// With a width for each face.
    #[new]
    fn new(
        py: Python<'_>,
        mesh: &TriangleMesh,
        epsilon: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let epsilon = epsilon.as_slice()?;
        let surface = mesh.surface.clone();
        let core = detached(py, || core::Screened::new(surface.mesh(), epsilon))?;
        Ok(Self {
            core: Mutex::new(core.map_err(to_python)?),
            surface,
        })
    }

    /// A row for each of `labels`: the indicator of its faces, spread.
    fn spread<'py>(
        &self,
        py: Python<'py>,
        of_faces: PyReadonlyArray1<'_, i64>,
        labels: PyReadonlyArray1<'_, i64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (of_faces, labels) = (of_faces.as_slice()?, labels.as_slice()?);
        let n = self.surface.mesh().n_vertices();
        let ((), values): (_, Bound<'_, PyArray1<f64>>) = filled(py, labels.len() * n, |values| {
            self.core
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .spread(self.surface.mesh(), of_faces, labels, values)
        })?;
        values.reshape([labels.len(), n])
    }
}
