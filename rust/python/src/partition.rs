use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use phaseatlas_core::partition as core;
use pyo3::prelude::*;

use crate::mesh::{TriangleMesh, array2};
use crate::pool::detached;
use crate::to_python;

/// A partition of a surface into charts, and the moves that improve it.
#[pyclass(module = "phaseatlas._core")]
pub struct Partition {
    core: core::Partition,
}

/// Energy, seam, cuts, distortion, overlap, area of the smallest chart; charts, overlapping charts.
type Figures = (f64, f64, f64, f64, f64, f64, usize, usize);

type Merges<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl Partition {
    #[new]
    fn new(py: Python<'_>, mesh: &TriangleMesh, distortion: f64) -> PyResult<Self> {
        let core = detached(py, || core::Partition::new(&mesh.surface, distortion))?;
        Ok(Self {
            core: core.map_err(to_python)?,
        })
    }

    fn set_labels(
        &mut self,
        py: Python<'_>,
        labels: PyReadonlyArray1<'_, i64>,
        reach: f64,
    ) -> PyResult<()> {
        let labels = labels.as_slice()?;
        detached(py, || self.core.set_labels(labels, reach))?.map_err(to_python)
    }

    fn carry_labels(
        &mut self,
        py: Python<'_>,
        labels: PyReadonlyArray1<'_, i64>,
        sensitivities: PyReadonlyArray1<'_, f64>,
        reach: f64,
    ) -> PyResult<()> {
        let (labels, sensitivities) = (labels.as_slice()?, sensitivities.as_slice()?);
        detached(py, || self.core.carry_labels(labels, sensitivities, reach))?.map_err(to_python)
    }

    fn sensitivities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = detached(py, || self.core.sensitivities())?;
        Ok(PyArray1::from_vec(py, values))
    }

    fn limit_tries(&mut self, tries: usize) {
        self.core.limit_tries(tries);
    }

    fn set_cells(&mut self, py: Python<'_>, count: usize) -> PyResult<()> {
        detached(py, || self.core.set_cells(count))
    }

    fn labels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.core.labels().iter().map(|&label| i64::from(label)))
    }

    fn figures(&self, py: Python<'_>) -> PyResult<Figures> {
        let f = detached(py, || self.core.figures())?;
        Ok((
            f.energy,
            f.seam,
            f.cuts,
            f.distortion,
            f.overlap,
            f.smallest,
            f.charts,
            f.overlapping,
        ))
    }

    fn merge(&mut self, py: Python<'_>) -> PyResult<()> {
        detached(py, || self.core.merge())
    }

    /// Pairs of charts, and the energy after each merge.
    fn merges<'py>(&self, py: Python<'py>) -> PyResult<Merges<'py>> {
        let merges = detached(py, || self.core.merges())?;
        let pairs: Vec<[i64; 2]> = merges
            .iter()
            .map(|merge| [merge.pair.0.into(), merge.pair.1.into()])
            .collect();
        let energies = PyArray1::from_iter(py, merges.iter().map(|merge| merge.energy));
        Ok((array2(py, &pairs)?, energies))
    }

    fn sweep(&mut self, py: Python<'_>) -> PyResult<bool> {
        detached(py, || self.core.sweep())
    }

    fn perturb(&mut self, py: Python<'_>, seed: u64, first: usize, end: usize) -> PyResult<usize> {
        detached(py, || self.core.perturb(seed, first..end))
    }

    fn allow_overlap(&mut self) {
        self.core.allow_overlap();
    }

    #[pyo3(signature = (*, upright = true))]
    fn forbid_overlap(&mut self, py: Python<'_>, upright: bool) -> PyResult<()> {
        detached(py, || self.core.forbid_overlap(upright))
    }

    fn failing<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let failing = detached(py, || self.core.failing())?;
        Ok(PyArray1::from_iter(py, failing.into_iter().map(i64::from)))
    }

    fn condemn(&mut self, py: Python<'_>, labels: PyReadonlyArray1<'_, i64>) -> PyResult<()> {
        let labels = labels.as_slice()?;
        detached(py, || self.core.condemn(labels))?.map_err(to_python)
    }

    fn split_failing(&mut self, py: Python<'_>, count: usize) -> PyResult<usize> {
        detached(py, || self.core.split_failing(count))
    }

    fn resize_tiny(&mut self, py: Python<'_>) -> PyResult<usize> {
        detached(py, || self.core.resize_tiny())
    }

    fn set_distortion(&mut self, distortion: f64) {
        self.core.set_distortion(distortion);
    }
}
