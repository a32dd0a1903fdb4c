use numpy::{PyArray1, PyReadonlyArray1};
use phaseatlas_core::lbfgs as core;
use pyo3::prelude::*;

use crate::pool::detached;
use crate::{filled, to_python};

/// Inverse Hessian of limited-memory BFGS.
#[pyclass(module = "phaseatlas._core")]
pub struct LimitedMemory(core::LimitedMemory);

#[pymethods]
impl LimitedMemory {
    #[new]
    fn new(n: usize, capacity: usize) -> PyResult<Self> {
        core::LimitedMemory::new(n, capacity)
            .map(Self)
            .map_err(to_python)
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn clear(&mut self) {
        self.0.clear();
    }

    /// Whether the pair was added: its curvature is positive.
    fn update(
        &mut self,
        py: Python<'_>,
        step: PyReadonlyArray1<'_, f64>,
        change: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<bool> {
        let (step, change) = (step.as_slice()?, change.as_slice()?);
        detached(py, || self.0.update(step, change))?.map_err(to_python)
    }

    /// -H gradient.
    fn direction<'py>(
        &self,
        py: Python<'py>,
        gradient: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let gradient = gradient.as_slice()?;
        let ((), direction) = filled(py, gradient.len(), |direction| {
            self.0.direction(gradient, direction)
        })?;
        Ok(direction)
    }
}
