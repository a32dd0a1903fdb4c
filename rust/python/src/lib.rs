//! Python bindings of `phaseatlas-core`: conversions, errors and the release of the GIL.

mod flatten;
mod functionals;
mod graph;
mod lbfgs;
mod mesh;
mod pool;
mod raster;

use phaseatlas_core::Error;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

fn to_python(error: Error) -> PyErr {
    match error {
        Error::OutOfMemory { .. } => PyMemoryError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<mesh::TriangleMesh>()?;
    module.add_class::<functionals::Perimeter>()?;
    module.add_class::<functionals::Area>()?;
    module.add_class::<functionals::Connectedness>()?;
    module.add_class::<functionals::Distortion>()?;
    module.add_class::<lbfgs::LimitedMemory>()?;
    module.add_function(wrap_pyfunction!(graph::label_components, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::cut_chart, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::lscm, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::bff, module)?)?;
    module.add_function(wrap_pyfunction!(raster::rasterize, module)?)?;
    Ok(())
}
