//! A set of faces as a mesh of its own, cut to a disk.

use super::cut::cut_to_disk;
use super::plane::is_planar;
use crate::error::{Error, Result};
use crate::mesh::TriangleMesh;

/// A connected set of faces of a surface as a topological disk: vertices where it is cut, or
/// where it touches itself, stand once on each side.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::flatten::ChartMesh;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let square = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let chart = ChartMesh::new(&square, &[1])?;
/// assert_eq!(chart.vertices, [0, 2, 3]);
/// assert_eq!((chart.euler_characteristic, chart.cut_length), (1, 0.0));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct ChartMesh {
    /// The disk.
    pub mesh: TriangleMesh,
    /// The surface vertex of each vertex of the disk.
    pub vertices: Vec<u32>,
    /// Euler characteristic of the domain before the cut; 1 for a disk.
    pub euler_characteristic: i64,
    /// Length of the cut.
    pub cut_length: f64,
}

impl ChartMesh {
    /// Builds the chart of the given faces of `surface`, in their order.
    ///
    /// # Errors
    /// [`Error::Empty`] for no faces, [`Error::IndexOutOfRange`], [`Error::Disconnected`] for
    /// faces that do not connect across edges.
    pub fn new(surface: &TriangleMesh, faces: &[i64]) -> Result<Self> {
        Self::build(surface, faces, false)
    }

    /// As [`Self::new`], but a piece of a plane is left with its holes.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_flat_holes(surface: &TriangleMesh, faces: &[i64]) -> Result<Self> {
        Self::build(surface, faces, true)
    }

    fn build(surface: &TriangleMesh, faces: &[i64], keep_holes: bool) -> Result<Self> {
        check_faces("faces", surface, faces)?;
        let corners: Vec<[u32; 3]> = faces.iter().map(|&f| surface.faces()[f as usize]).collect();
        let costs: Option<Vec<[f64; 3]>> = surface
            .seam_costs()
            .map(|costs| faces.iter().map(|&f| costs[f as usize]).collect());
        let domain = Submesh::new(surface, &corners, costs.as_deref())?;
        let euler_characteristic = domain.mesh.euler_characteristic();
        // A flat piece with holes is in the plane as it is.
        let with_holes = domain.mesh.n_boundary_loops() > 1 && domain.mesh.genus() == 0;
        if euler_characteristic == 1 || (keep_holes && with_holes && is_planar(&domain.mesh)) {
            return Ok(Self {
                mesh: domain.mesh,
                vertices: domain.vertices,
                euler_characteristic,
                cut_length: 0.0,
            });
        }
        let cut = cut_to_disk(&domain.mesh);
        let split = split_corners(&domain.mesh, &cut.edges);
        let vertices: Vec<u32> = split
            .origin
            .iter()
            .map(|&v| domain.vertices[v as usize])
            .collect();
        let positions = vertices
            .iter()
            .map(|&v| surface.vertices()[v as usize])
            .collect();
        let mesh = with_costs(
            TriangleMesh::accepted(positions, &split.faces)?,
            costs.as_deref(),
        )?;
        if mesh.euler_characteristic() != 1 {
            return Err(Error::Topology {
                argument: "faces",
                reason: format!(
                    "the cut domain has Euler characteristic {}, not 1",
                    mesh.euler_characteristic()
                ),
            });
        }
        Ok(Self {
            mesh,
            vertices,
            euler_characteristic,
            cut_length: cut.length,
        })
    }
}

/// Refuses faces that are not of the surface.
pub(super) fn check_faces(
    argument: &'static str,
    surface: &TriangleMesh,
    faces: &[i64],
) -> Result<()> {
    for (index, &f) in faces.iter().enumerate() {
        if f < 0 || f as usize >= surface.n_faces() {
            return Err(Error::Topology {
                argument,
                reason: format!(
                    "{argument}[{index}] = {f} is outside 0..{}",
                    surface.n_faces()
                ),
            });
        }
    }
    Ok(())
}

/// Faces with vertices numbered in order of first use; a vertex where the faces touch without
/// sharing an edge is split into one vertex a fan.
struct Submesh {
    mesh: TriangleMesh,
    vertices: Vec<u32>,
}

impl Submesh {
    fn new(
        surface: &TriangleMesh,
        corners: &[[u32; 3]],
        costs: Option<&[[f64; 3]]>,
    ) -> Result<Self> {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * corners.len());
        for (f, face) in corners.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                sides.push(([a.min(b), a.max(b)], (3 * f + k) as u32));
            }
        }
        sides.sort_unstable();
        let glued = sides
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|group| group.len() == 2)
            .map(|group| (group[0].1, group[1].1));
        let split = join_corners(corners, glued);
        let positions = split
            .origin
            .iter()
            .map(|&v| surface.vertices()[v as usize])
            .collect();
        Ok(Self {
            mesh: with_costs(TriangleMesh::accepted(positions, &split.faces)?, costs)?,
            vertices: split.origin,
        })
    }
}

fn with_costs(mesh: TriangleMesh, costs: Option<&[[f64; 3]]>) -> Result<TriangleMesh> {
    match costs {
        Some(costs) => mesh.with_seam_costs(costs),
        None => Ok(mesh),
    }
}

/// Faces over new vertices, and the old vertex of each new one.
struct SplitFaces {
    faces: Vec<[i64; 3]>,
    origin: Vec<u32>,
}

/// Numbers the corners of the faces so that two corners are one vertex exactly where a chain of
/// glued half-edge pairs joins them.
fn join_corners(corners: &[[u32; 3]], glued: impl Iterator<Item = (u32, u32)>) -> SplitFaces {
    let mut sets = petgraph::unionfind::UnionFind::<u32>::new(3 * corners.len());
    let next = |h: u32| h - h % 3 + (h + 1) % 3;
    for (h, opposite) in glued {
        sets.union(h, next(opposite));
        sets.union(next(h), opposite);
    }
    let mut index = vec![-1_i64; 3 * corners.len()];
    let mut origin = Vec::new();
    let mut faces = Vec::with_capacity(corners.len());
    for (f, face) in corners.iter().enumerate() {
        let mut corner_index = [0; 3];
        for k in 0..3 {
            let root = sets.find((3 * f + k) as u32) as usize;
            if index[root] < 0 {
                index[root] = origin.len() as i64;
                origin.push(face[k]);
            }
            corner_index[k] = index[root];
        }
        faces.push(corner_index);
    }
    SplitFaces { faces, origin }
}

/// Splits the mesh along the marked edges.
fn split_corners(mesh: &TriangleMesh, cut: &[bool]) -> SplitFaces {
    let glued = mesh
        .edge_half_edges()
        .iter()
        .zip(cut)
        .filter(|(half_edges, cut)| !**cut && half_edges[1] != crate::mesh::NONE)
        .map(|(half_edges, _)| (half_edges[0], half_edges[1]));
    join_corners(mesh.faces(), glued)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grid, torus};

    #[test]
    fn disk_is_left_alone() {
        let mesh = grid(6, 6, |_, _| 0.0);
        let faces: Vec<i64> = (0..30).collect();
        let chart = ChartMesh::new(&mesh, &faces).unwrap();
        assert_eq!((chart.euler_characteristic, chart.cut_length), (1, 0.0));
        assert_eq!(chart.mesh.n_faces(), 30);
    }

    #[test]
    fn annulus_is_cut_across() {
        let mesh = grid(12, 12, |_, _| 0.0);
        let centre = |f: usize, axis: usize| {
            mesh.faces()[f]
                .iter()
                .map(|&v| mesh.vertices()[v as usize][axis])
                .sum::<f64>()
                / 3.0
                - 0.5
        };
        let faces: Vec<i64> = (0..mesh.n_faces())
            .filter(|&f| centre(f, 0).abs().max(centre(f, 1).abs()) > 0.25)
            .map(|f| f as i64)
            .collect();
        let chart = ChartMesh::new(&mesh, &faces).unwrap();
        assert_eq!(chart.euler_characteristic, 0);
        assert!(
            (chart.cut_length - 0.25).abs() < 1e-12,
            "{}",
            chart.cut_length
        );
    }

    #[test]
    fn closed_surfaces_become_disks() {
        let mesh = torus(30, 12, 0.3);
        let all: Vec<i64> = (0..mesh.n_faces() as i64).collect();
        let chart = ChartMesh::new(&mesh, &all).unwrap();
        assert_eq!(chart.euler_characteristic, 0);
        assert_eq!(chart.mesh.euler_characteristic(), 1);
        // A meridian and the inner equator, each at most a little longer than the smooth curve.
        let tau = std::f64::consts::TAU;
        assert!(
            chart.cut_length < 1.2 * tau * (0.3 + 0.7),
            "{}",
            chart.cut_length
        );
    }

    #[test]
    fn closed_surfaces_whose_vertices_are_all_neighbours_become_disks() {
        // Two fans over a polygon: from any vertex the farthest one is one or two edges away.
        for (sides, height) in [(3, 0.1), (3, 10.0), (4, 1.0), (9, 0.1), (9, 10.0)] {
            let angle = |i: usize| std::f64::consts::TAU * i as f64 / sides as f64;
            let mut vertices: Vec<[f64; 3]> = (0..sides)
                .map(|i| [angle(i).cos(), angle(i).sin(), 0.0])
                .collect();
            vertices.extend([[0.0, 0.0, height], [0.0, 0.0, -height]]);
            let faces: Vec<[i64; 3]> = (0..sides)
                .flat_map(|i| {
                    let [a, b] = [i, (i + 1) % sides].map(|v| v as i64);
                    [[a, b, sides as i64], [b, a, sides as i64 + 1]]
                })
                .collect();
            let mesh = TriangleMesh::new(vertices, &faces).unwrap();
            let all: Vec<i64> = (0..mesh.n_faces() as i64).collect();
            let chart = ChartMesh::new(&mesh, &all).unwrap();
            assert_eq!(chart.mesh.euler_characteristic(), 1);
        }
        let points = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mesh = TriangleMesh::new(points, &faces).unwrap();
        let chart = ChartMesh::new(&mesh, &[0, 1, 2, 3]).unwrap();
        assert_eq!(chart.mesh.euler_characteristic(), 1);
        assert_eq!(chart.vertices.len(), 5);
        assert!(chart.cut_length >= 2.0);
    }

    #[test]
    fn corner_contact_is_split() {
        let mesh = grid(2, 2, |_, _| 0.0);
        // Two triangles that share the centre alone are not one chart.
        let touching: Vec<i64> = (0..mesh.n_faces() as i64)
            .filter(|&f| mesh.faces()[f as usize].contains(&4))
            .collect();
        assert!(matches!(
            ChartMesh::new(&mesh, &[touching[0], touching[3]]),
            Err(Error::Disconnected { .. })
        ));
    }
}
