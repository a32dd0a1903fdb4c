//! Buffers that are kept from one use to the next.

use std::sync::{Mutex, PoisonError};

/// Takes buffers out for the time of their use, [`None`] where all are in use: a lock that is held
/// while the thread pool works could be asked for again by the same thread.
pub(crate) fn take<T>(buffers: &Mutex<Vec<T>>) -> Option<T> {
    buffers.lock().unwrap_or_else(PoisonError::into_inner).pop()
}

pub(crate) fn give_back<T>(buffers: &Mutex<Vec<T>>, buffer: T) {
    buffers
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(buffer);
}
