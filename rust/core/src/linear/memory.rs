//! Memory that faer works in.

use faer::dyn_stack::{MemBuffer, StackReq};

use crate::error::{Error, Result};

/// Room for the work on a matrix of `size` rows.
pub(super) fn buffer(size: usize, request: StackReq) -> Result<MemBuffer> {
    MemBuffer::try_new(request).map_err(|_| out_of_memory(size))
}

pub(super) fn out_of_memory(size: usize) -> Error {
    Error::OutOfMemory {
        argument: "matrix",
        size,
        unit: "unknowns",
    }
}
