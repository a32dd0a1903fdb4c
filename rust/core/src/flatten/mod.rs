//! Chart maps, section 4: a chart domain is cut to a disk and flattened.

mod bff;
mod chart;
mod cut;
mod lscm;

pub use bff::{Bff, bff};
pub use chart::ChartMesh;
pub use lscm::lscm;

use crate::error::{Error, Result};
use crate::mesh::{NONE, TriangleMesh};

fn check_disk(mesh: &TriangleMesh) -> Result<()> {
    if mesh.euler_characteristic() != 1 || mesh.n_boundary_loops() != 1 {
        return Err(Error::Topology {
            argument: "mesh",
            reason: format!(
                "a disk is needed; this has Euler characteristic {} and {} boundary loops",
                mesh.euler_characteristic(),
                mesh.n_boundary_loops()
            ),
        });
    }
    Ok(())
}

/// The vertices of the one boundary loop of a disk, in its orientation.
fn border_vertices(mesh: &TriangleMesh) -> Vec<usize> {
    let mut next = vec![NONE; mesh.n_vertices()];
    for half_edges in mesh.edge_half_edges().iter().filter(|h| h[1] == NONE) {
        let (f, k) = ((half_edges[0] / 3) as usize, (half_edges[0] % 3) as usize);
        next[mesh.faces()[f][k] as usize] = mesh.faces()[f][(k + 1) % 3];
    }
    let start = next.iter().position(|&w| w != NONE);
    std::iter::successors(start, |&v| {
        let w = next[v] as usize;
        (Some(w) != start).then_some(w)
    })
    .collect()
}
