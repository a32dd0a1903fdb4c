//! Memory of the machine.

use pyo3::prelude::*;
use sysinfo::System;

/// Bytes that can still be taken: what the machine has left, or less where the process is confined
/// to a part of it.
#[pyfunction]
pub fn available_memory() -> u64 {
    let mut system = System::new();
    system.refresh_memory();
    let available = system.available_memory();
    match system.cgroup_limits() {
        Some(limits) => available.min(limits.free_memory),
        None => available,
    }
}
