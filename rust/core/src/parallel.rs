//! Work in chunks whose size is fixed, so that no result depends on the number of threads.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Vertices (or faces) that one task handles.
pub(crate) const CHUNK: usize = 4096;

/// Sums what the tasks return in the order of the tasks.
pub(crate) fn ordered_sum(parts: impl IndexedParallelIterator<Item = f64>) -> f64 {
    let parts: Vec<f64> = parts.collect();
    parts.iter().sum()
}

/// Buffers that are kept from one use to the next.
#[derive(Debug)]
pub(crate) struct Buffers<T>(Mutex<Vec<T>>);

impl<T> Buffers<T> {
    /// Takes a buffer out for the time of its use, [`None`] where all are in use: a lock that is
    /// held while the thread pool works could be asked for again by the same thread.
    pub(crate) fn take(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }

    /// Keeps a buffer for the next use.
    pub(crate) fn give_back(&self, buffer: T) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(buffer);
    }
}

impl<T> Default for Buffers<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}
