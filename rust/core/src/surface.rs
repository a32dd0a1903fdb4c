//! A mesh and what is built from it once for all functionals.

use std::sync::OnceLock;

use crate::error::Result;
use crate::linear::Ordering;
use crate::mesh::TriangleMesh;
use crate::operators::DirichletSystem;

/// A mesh, and at the first call its Dirichlet system.
///
/// # Examples
/// ```
/// use phaseatlas_core::{Surface, TriangleMesh};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let surface = Surface::new(TriangleMesh::new(corners, &[[0, 1, 2]])?);
/// assert_eq!(surface.mesh().area(), 0.5);
/// assert_eq!(surface.dirichlet_system()?.len(), 6);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Surface {
    mesh: TriangleMesh,
    dirichlet_system: OnceLock<DirichletSystem>,
}

impl Surface {
    /// Takes a mesh; nothing is built yet.
    #[must_use]
    pub fn new(mesh: TriangleMesh) -> Self {
        Self {
            mesh,
            dirichlet_system: OnceLock::new(),
        }
    }

    /// The mesh.
    #[must_use]
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The Dirichlet system of the mesh, in the order of least work: it is factored many times.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn dirichlet_system(&self) -> Result<&DirichletSystem> {
        if let Some(system) = self.dirichlet_system.get() {
            return Ok(system);
        }
        let system = DirichletSystem::new(&self.mesh, Ordering::LeastWork)?;
        Ok(self.dirichlet_system.get_or_init(|| system))
    }
}
