use numpy::{PyArray1, PyReadonlyArray1};
use phaseatlas_core::functionals::{self as core, Form, Formulation, Functional, Phases};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::mesh::TriangleMesh;
use crate::pool::detached;
use crate::{filled, to_python};

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

fn evaluate<'py>(
    py: Python<'py>,
    functional: &dyn Functional,
    u: &PyReadonlyArray1<'_, f64>,
) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
    let u = u.as_slice()?;
    filled(py, u.len(), |gradient| {
        functional.value_and_gradient(u, gradient)
    })
}

#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Perimeter(core::Perimeter);

#[pymethods]
impl Perimeter {
    #[new]
    #[pyo3(signature = (mesh, epsilon, weight=None, eta=0.0, sigma=1.0, seam_cost=None))]
    fn new(
        py: Python<'_>,
        mesh: &TriangleMesh,
        epsilon: f64,
        weight: Option<PyReadonlyArray1<'_, f64>>,
        eta: f64,
        sigma: f64,
        seam_cost: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let weight = weight.as_ref().map(|w| w.as_slice()).transpose()?;
        let cost = seam_cost.as_ref().map(|g| g.as_slice()).transpose()?;
        let surface = mesh.surface.clone();
        detached(py, || match (weight, cost) {
            (None, None) => core::Perimeter::new(surface, epsilon),
            (Some(weight), None) => core::Perimeter::weighted(surface, epsilon, weight, eta, sigma),
            (_, Some(cost)) => {
                let parent = weight.map(|weight| core::Parent { weight, eta, sigma });
                core::Perimeter::costed(surface, epsilon, parent, cost)
            }
        })?
        .map(Self)
        .map_err(to_python)
    }

    fn value_and_gradient<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        evaluate(py, &self.0, &u)
    }

    /// Off-diagonal entries, one an edge, and diagonal.
    fn hessian<'py>(&self, py: Python<'py>, u: PyReadonlyArray1<'_, f64>) -> PyResult<Pair<'py>> {
        let u = u.as_slice()?;
        let (edges, diagonal) = detached(py, || self.0.hessian(u))?.map_err(to_python)?;
        Ok((
            PyArray1::from_vec(py, edges),
            PyArray1::from_vec(py, diagonal),
        ))
    }
}

#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Area(core::Area);

#[pymethods]
impl Area {
    #[new]
    #[pyo3(signature = (mesh, delta, weight=None))]
    fn new(
        mesh: &TriangleMesh,
        delta: f64,
        weight: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let weight = weight.as_ref().map(|w| w.as_slice()).transpose()?;
        core::Area::new(mesh.core(), delta, weight)
            .map(Self)
            .map_err(to_python)
    }

    #[getter]
    fn total(&self) -> f64 {
        self.0.total()
    }

    fn value_and_gradient<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        evaluate(py, &self.0, &u)
    }

    /// Diagonal; the other entries are 0.
    fn hessian<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let u = u.as_slice()?;
        let diagonal = detached(py, || self.0.hessian(u))?.map_err(to_python)?;
        Ok(PyArray1::from_vec(py, diagonal))
    }
}

#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Connectedness(core::Connectedness);

#[pymethods]
impl Connectedness {
    #[new]
    #[pyo3(signature = (mesh, threshold, weight=None, phase="both", form="pairs", saturation=None, plateau=1.0, inside=None))]
    #[expect(
        clippy::too_many_arguments,
        reason = "they are those of the Python class"
    )]
    fn new(
        mesh: &TriangleMesh,
        threshold: f64,
        weight: Option<PyReadonlyArray1<'_, f64>>,
        phase: &str,
        form: &str,
        saturation: Option<f64>,
        plateau: f64,
        inside: Option<PyReadonlyArray1<'_, bool>>,
    ) -> PyResult<Self> {
        let phases = match phase {
            "both" => Phases::Both,
            "positive" => Phases::Positive,
            "negative" => Phases::Negative,
            other => {
                return Err(PyValueError::new_err(format!(
                    "phase: {other:?} must be \"both\", \"positive\" or \"negative\""
                )));
            }
        };
        let form = match form {
            "pairs" => Form::Pairs,
            "tree" => Form::Tree,
            other => {
                return Err(PyValueError::new_err(format!(
                    "form: {other:?} must be \"pairs\" or \"tree\""
                )));
            }
        };
        let weight = weight.as_ref().map(|w| w.as_slice()).transpose()?;
        let inside = inside.as_ref().map(|faces| faces.as_slice()).transpose()?;
        core::Connectedness::new(mesh.surface.clone(), threshold, weight, phases)
            .and_then(|functional| functional.with_plateau(plateau))
            .and_then(|functional| match saturation {
                None => Ok(functional),
                Some(area) => functional.with_saturation(area),
            })
            .and_then(|functional| match inside {
                None => Ok(functional),
                Some(inside) => functional.within(inside),
            })
            .map(|functional| Self(functional.with_form(form)))
            .map_err(to_python)
    }

    fn value_and_gradient<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        evaluate(py, &self.0, &u)
    }

    /// Components with mass of the positive and of the negative phase.
    fn components(&self, py: Python<'_>, u: PyReadonlyArray1<'_, f64>) -> PyResult<(usize, usize)> {
        let u = u.as_slice()?;
        detached(py, || self.0.components(u))?.map_err(to_python)
    }
}

#[pyclass(frozen, module = "phaseatlas._core")]
pub struct Distortion(core::Distortion);

#[pymethods]
impl Distortion {
    #[new]
    #[pyo3(signature = (mesh, epsilon, law, delta, eta, weight=None))]
    fn new(
        py: Python<'_>,
        mesh: &TriangleMesh,
        epsilon: f64,
        law: &str,
        delta: f64,
        eta: f64,
        weight: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let formulation = match law {
            "paper" => Formulation::Paper,
            "sharp" => Formulation::Sharp,
            other => {
                return Err(PyValueError::new_err(format!(
                    "law: {other:?} must be \"paper\" or \"sharp\""
                )));
            }
        };
        let weight = weight.as_ref().map(|w| w.as_slice()).transpose()?;
        let surface = mesh.surface.clone();
        detached(py, || {
            core::Distortion::new(surface, formulation, epsilon, delta, eta, weight)
        })?
        .map(Self)
        .map_err(to_python)
    }

    fn value_and_gradient<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        evaluate(py, &self.0, &u)
    }

    /// Log scale factors of the positive and of the negative phase.
    fn log_scale<'py>(&self, py: Python<'py>, u: PyReadonlyArray1<'_, f64>) -> PyResult<Pair<'py>> {
        let u = u.as_slice()?;
        let [positive, negative] = detached(py, || self.0.log_scale(u))?.map_err(to_python)?;
        Ok((
            PyArray1::from_vec(py, positive),
            PyArray1::from_vec(py, negative),
        ))
    }
}
