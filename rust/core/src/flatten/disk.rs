//! The boundary of a disk.

use crate::error::{Error, Result};
use crate::mesh::TriangleMesh;

/// The vertices of the one boundary loop of a disk, in its orientation.
///
/// # Errors
/// [`Error::Topology`] for a mesh that is no disk.
pub(super) fn boundary_of_disk(mesh: &TriangleMesh) -> Result<&[u32]> {
    match mesh.boundary_loops() {
        [boundary] if mesh.euler_characteristic() == 1 => Ok(boundary),
        _ => Err(Error::Topology {
            argument: "mesh",
            reason: format!(
                "must be a disk; this has Euler characteristic {} and {} boundary loops",
                mesh.euler_characteristic(),
                mesh.n_boundary_loops()
            ),
        }),
    }
}
