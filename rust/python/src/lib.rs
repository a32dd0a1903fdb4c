//! Python bindings of `phaseatlas-core`: conversions, errors and the release of the GIL.

#![allow(
    clippy::needless_pass_by_value,
    reason = "pyo3 makes the arguments of a call"
)]

mod bake;
mod flatten;
mod functionals;
mod graph;
mod lbfgs;
mod memory;
mod mesh;
mod obj;
mod packing;
mod partition;
mod pool;
mod raster;
mod repair;
mod screened;
mod simplify;

use numpy::{PyArray1, PyArrayMethods};
use phaseatlas_core::Error;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

fn to_python(error: Error) -> PyErr {
    match error {
        Error::OutOfMemory { .. } => PyMemoryError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// A new vector of `n` values that `work` fills in the pool, and what it returns.
fn filled<T: Send>(
    py: Python<'_>,
    n: usize,
    work: impl FnOnce(&mut [f64]) -> phaseatlas_core::Result<T> + Send,
) -> PyResult<(T, Bound<'_, PyArray1<f64>>)> {
    let vector = PyArray1::zeros(py, n, false);
    let mut borrowed = vector.readwrite();
    let entries = borrowed.as_slice_mut()?;
    let value = pool::detached(py, || work(entries))?.map_err(to_python)?;
    drop(borrowed);
    Ok((value, vector))
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    // The first array imports a part of numpy, and panics where Ctrl-C breaks that off: not in the
    // middle of a call.
    drop(PyArray1::<f64>::zeros(module.py(), 0, false));
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<mesh::TriangleMesh>()?;
    module.add_class::<functionals::Perimeter>()?;
    module.add_class::<functionals::Area>()?;
    module.add_class::<functionals::Connectedness>()?;
    module.add_class::<functionals::Distortion>()?;
    module.add_class::<lbfgs::LimitedMemory>()?;
    module.add_class::<partition::Partition>()?;
    module.add_class::<screened::Screened>()?;
    module.add_function(wrap_pyfunction!(graph::label_components, module)?)?;
    module.add_function(wrap_pyfunction!(graph::edge_components, module)?)?;
    module.add_function(wrap_pyfunction!(graph::share_out, module)?)?;
    module.add_class::<flatten::CutChart>()?;
    module.add_class::<flatten::ScaledMap>()?;
    module.add_function(wrap_pyfunction!(flatten::cut_chart, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::lscm, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::bff, module)?)?;
    module.add_class::<flatten::GrownChart>()?;
    module.add_class::<flatten::Layout>()?;
    module.add_function(wrap_pyfunction!(flatten::grow_chart, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::isometric, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::symmetric_dirichlet, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::in_plane, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::extend, module)?)?;
    module.add_function(wrap_pyfunction!(flatten::faults, module)?)?;
    module.add_function(wrap_pyfunction!(packing::most_padding, module)?)?;
    module.add_function(wrap_pyfunction!(packing::pack, module)?)?;
    module.add_function(wrap_pyfunction!(raster::rasterize, module)?)?;
    module.add_function(wrap_pyfunction!(raster::nearest, module)?)?;
    module.add_function(wrap_pyfunction!(obj::parse_obj, module)?)?;
    module.add_function(wrap_pyfunction!(simplify::simplify, module)?)?;
    module.add_function(wrap_pyfunction!(simplify::parents, module)?)?;
    module.add_class::<repair::Repair>()?;
    module.add_function(wrap_pyfunction!(repair::triangulate, module)?)?;
    module.add_class::<bake::Bake>()?;
    module.add_function(wrap_pyfunction!(bake::sample, module)?)?;
    module.add_function(wrap_pyfunction!(memory::available_memory, module)?)?;
    module.add_function(wrap_pyfunction!(pool::size, module)?)?;
    module.add("BYTES_PER_TEXEL", phaseatlas_core::bake::BYTES_PER_TEXEL)?;
    module.add("MAX_RESOLUTION", phaseatlas_core::raster::MAX_RESOLUTION)?;
    Ok(())
}
