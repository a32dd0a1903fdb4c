//! The thread pool that all calls from Python run in.

use std::num::NonZero;
use std::sync::{Arc, Mutex, PoisonError};
use std::{env, process, thread};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// The process that built the pool, and the pool.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs `work` without the GIL in the pool of this process.
///
/// A forked process, such as a worker of `multiprocessing`, inherits a pool without its threads
/// and would wait for them for ever: it builds its own. `RAYON_NUM_THREADS` makes it smaller.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| Ok(current()?.install(work)))
}

fn current() -> PyResult<Arc<ThreadPool>> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((owner, threads)) = &*pool
        && *owner == process::id()
    {
        return Ok(threads.clone());
    }
    let threads = ThreadPoolBuilder::new()
        .num_threads(size())
        .build()
        .map(Arc::new)
        .map_err(|error| PyRuntimeError::new_err(format!("no thread pool: {error}")))?;
    // The parent's pool is leaked: dropping it would wait for its threads.
    if let Some(inherited) = pool.replace((process::id(), threads.clone())) {
        std::mem::forget(inherited);
    }
    Ok(threads)
}

/// Number of threads: that of the cores, or what `RAYON_NUM_THREADS` asks for if it is less.
#[pyfunction]
#[pyo3(name = "n_threads")]
pub(crate) fn size() -> usize {
    // More threads than cores only wait for each other, and thousands run out of memory.
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let asked = env::var("RAYON_NUM_THREADS")
        .ok()
        .and_then(|text| text.trim().parse().ok());
    match asked {
        Some(threads @ 1..) => cores.min(threads),
        _ => cores,
    }
}
