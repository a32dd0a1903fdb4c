//! A validated triangle mesh: how its faces hang together, and what their shapes are.

mod geometry;
mod topology;

use crate::error::{Result, check_length, check_parameter};
use geometry::Geometry;
pub(crate) use geometry::{cross, distance, dot, is_face, subtract};
use topology::Topology;
pub use topology::{Adjacency, NONE};

/// A face is degenerate where twice its area is at most this fraction of its longest edge squared:
/// the area then has fewer than four digits.
pub(crate) const DEGENERATE: f64 = 1e-12;

/// What an infinite factor on the length of a seam counts for where costs are added: more than any
/// boundary, or any way around, is worth.
pub(crate) const FORBIDDEN: f64 = 1e6;

/// An edge-manifold, vertex-manifold, consistently oriented triangle mesh with or without boundary,
/// connected unless built of [`Self::pieces`], and the quantities of section 3 that depend on it alone.
///
/// Half-edge `3 f + k` runs from corner `k` of face `f` to corner `(k + 1) % 3`.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A square, cut in two along a diagonal.
/// let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let mesh = TriangleMesh::new(corners, &[[0, 1, 2], [0, 2, 3]])?;
/// assert_eq!(mesh.area(), 1.0);
/// assert_eq!(mesh.edges(), [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]);
/// assert_eq!(mesh.boundary_loops(), [[0, 1, 2, 3]]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct TriangleMesh {
    vertices: Vec<[f64; 3]>,
    topology: Topology,
    geometry: Geometry,
    /// Factor on the length of each edge where a seam runs along it; empty where all are 1.
    seam_costs: Vec<f64>,
}

impl TriangleMesh {
    /// Builds and validates the mesh.
    ///
    /// # Errors
    /// Every defect of the input is an [`crate::Error`] that names the culprit: nothing is repaired.
    pub fn new(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Result<Self> {
        Self::build(vertices, faces, DEGENERATE, false)
    }

    /// Builds a mesh of faces that were accepted before, scaled or in part.
    ///
    /// Scaling rounds, so that a needle at the bound of [`Self::new`] may fall below it: here any
    /// face of positive area will do.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn accepted(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Result<Self> {
        Self::build(vertices, faces, 0.0, false)
    }

    /// Builds a mesh of pieces that need not hang together, each of which would be accepted.
    ///
    /// # Errors
    /// As [`Self::accepted`], but for [`crate::Error::Disconnected`].
    pub fn pieces(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Result<Self> {
        Self::build(vertices, faces, 0.0, true)
    }

    fn build(
        vertices: Vec<[f64; 3]>,
        faces: &[[i64; 3]],
        degenerate: f64,
        apart: bool,
    ) -> Result<Self> {
        let faces = topology::check_indices(&vertices, faces)?;
        let topology = Topology::new(vertices.len(), faces, apart)?;
        let geometry = Geometry::new(&vertices, &topology, degenerate)?;
        Ok(Self {
            vertices,
            topology,
            geometry,
            seam_costs: Vec::new(),
        })
    }

    /// Gives every edge a factor on its length where a seam runs along it.
    ///
    /// There is one for each half-edge; an edge takes the larger of its two. No seam runs along an
    /// edge whose factor is infinite.
    ///
    /// # Errors
    /// For another number of faces, or a factor that is not positive.
    pub fn with_seam_costs(mut self, costs: &[[f64; 3]]) -> Result<Self> {
        check_length("seam_costs", costs.len(), self.n_faces())?;
        let costs = costs.as_flattened();
        for &cost in costs {
            check_parameter("seam_costs", cost, cost > 0.0, "a positive number")?;
        }
        let larger = |&[h, opposite]: &[u32; 2]| {
            let cost = costs[h as usize];
            costs
                .get(opposite as usize)
                .map_or(cost, |&other| cost.max(other))
        };
        self.seam_costs = self.edge_half_edges().iter().map(larger).collect();
        Ok(self)
    }

    /// What [`Self::with_seam_costs`] was given, or as good; none where all are 1.
    #[must_use]
    pub fn seam_costs(&self) -> Option<Vec<[f64; 3]>> {
        if self.seam_costs.is_empty() {
            return None;
        }
        let mut costs = vec![[1.0; 3]; self.n_faces()];
        for (sides, &cost) in self.edge_half_edges().iter().zip(&self.seam_costs) {
            for &h in sides.iter().filter(|&&h| h != NONE) {
                costs[h as usize / 3][h as usize % 3] = cost;
            }
        }
        Some(costs)
    }

    /// What a seam along an edge costs for its length.
    #[must_use]
    pub fn seam_cost(&self, edge: usize) -> f64 {
        self.seam_costs.get(edge).copied().unwrap_or(1.0)
    }

    /// Positions of the vertices.
    #[must_use]
    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.vertices
    }

    /// The three vertices of each face, counterclockwise as seen from outside.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.topology.faces
    }

    /// Number of vertices.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    /// Number of faces.
    #[must_use]
    pub fn n_faces(&self) -> usize {
        self.faces().len()
    }

    /// The edges, each once, smaller vertex first, sorted.
    #[must_use]
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.topology.edges
    }

    /// The one or two half-edges of every edge; [`NONE`] at the boundary.
    #[must_use]
    pub fn edge_half_edges(&self) -> &[[u32; 2]] {
        &self.topology.edge_half_edges
    }

    /// The vertices that a half-edge leads from and to.
    #[must_use]
    pub fn half_edge_ends(&self, half_edge: u32) -> [u32; 2] {
        topology::ends(self.faces(), half_edge)
    }

    /// The face across each half-edge; [`NONE`] at the boundary.
    #[must_use]
    pub fn neighbours(&self) -> &[[u32; 3]] {
        &self.topology.neighbours
    }

    /// The vertices around each vertex.
    #[must_use]
    pub fn adjacency(&self) -> &Adjacency {
        &self.topology.adjacency
    }

    /// Which vertices lie on the boundary.
    #[must_use]
    pub fn on_boundary(&self) -> &[bool] {
        &self.topology.on_boundary
    }

    /// The vertices of each boundary loop along its half-edges, from the lowest one.
    #[must_use]
    pub fn boundary_loops(&self) -> &[Vec<u32>] {
        &self.topology.boundary_loops
    }

    /// Number of boundary loops.
    #[must_use]
    pub fn n_boundary_loops(&self) -> usize {
        self.topology.boundary_loops.len()
    }

    /// V - E + F.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices.len() as i64 - self.edges().len() as i64 + self.n_faces() as i64
    }

    /// Genus of a connected surface after its boundary loops are capped.
    #[must_use]
    pub fn genus(&self) -> i64 {
        (2 - self.euler_characteristic() - self.n_boundary_loops() as i64) / 2
    }

    /// Face areas, sum = surface area.
    #[must_use]
    pub fn areas(&self) -> &[f64] {
        &self.geometry.areas
    }

    /// Face diameters: the longest edge.
    #[must_use]
    pub fn diameters(&self) -> &[f64] {
        &self.geometry.diameters
    }

    /// Lumped mass of every vertex: a third of the area of its faces.
    #[must_use]
    pub fn mass(&self) -> &[f64] {
        &self.geometry.mass
    }

    /// Integrated Gauss curvature: 2 pi - sum of angles, at the boundary pi - sum of angles.
    #[must_use]
    pub fn angle_defects(&self) -> &[f64] {
        &self.geometry.angle_defects
    }

    /// Half the cotangent of the angle opposite to each half-edge.
    #[must_use]
    pub fn half_cotangents(&self) -> &[[f64; 3]] {
        &self.geometry.half_cotangents
    }

    /// Area of the surface.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.areas().iter().sum()
    }

    /// Mean length of the edges.
    #[must_use]
    pub fn mean_edge_length(&self) -> f64 {
        let total: f64 = self
            .edges()
            .iter()
            .map(|&[a, b]| distance(self.vertices[a as usize], self.vertices[b as usize]))
            .sum();
        total / self.edges().len() as f64
    }

    /// Mean of a vertex quantity over the corners of face `f`.
    #[inline]
    pub(crate) fn face_mean(&self, values: &[f64], f: usize) -> f64 {
        let [a, b, c] = self.topology.faces[f];
        (values[a as usize] + values[b as usize] + values[c as usize]) / 3.0
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::error::Error;
    use crate::testing::grid;

    fn tetrahedron() -> (Vec<[f64; 3]>, Vec<[i64; 3]>) {
        (
            vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
            ],
            vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        )
    }

    #[test]
    fn grid_quantities() {
        let mesh = grid(8, 5, |_, _| 0.0);
        assert!((mesh.area() - 1.0).abs() < 1e-14);
        assert!((mesh.mass().iter().sum::<f64>() - 1.0).abs() < 1e-14);
        assert_eq!(mesh.euler_characteristic(), 1);
        assert_eq!((mesh.genus(), mesh.n_boundary_loops()), (0, 1));
        assert!((mesh.angle_defects().iter().sum::<f64>() - 2.0 * PI).abs() < 1e-12);
    }

    #[test]
    fn closed_surface() {
        let (vertices, faces) = tetrahedron();
        let mesh = TriangleMesh::new(vertices, &faces).unwrap();
        assert_eq!((mesh.genus(), mesh.n_boundary_loops()), (0, 0));
        assert!((mesh.angle_defects().iter().sum::<f64>() - 4.0 * PI).abs() < 1e-12);
    }

    #[test]
    fn an_edge_costs_what_the_dearer_half_edge_does() {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let square = || TriangleMesh::new(corners.clone(), &[[0, 1, 2], [0, 2, 3]]).unwrap();
        assert_eq!(square().seam_cost(1), 1.0);
        let costs = [[1.0, 2.0, 3.0], [4.0, 5.0, 0.5]];
        let mesh = square().with_seam_costs(&costs).unwrap();
        let found: Vec<_> = (0..5).map(|edge| mesh.seam_cost(edge)).collect();
        assert_eq!(found, [1.0, 4.0, 0.5, 2.0, 5.0]);
        let again = square()
            .with_seam_costs(&mesh.seam_costs().unwrap())
            .unwrap();
        assert_eq!(
            (0..5).map(|edge| again.seam_cost(edge)).collect::<Vec<_>>(),
            found
        );
        for bad in [[[1.0; 3], [0.0; 3]], [[1.0; 3], [f64::NAN; 3]]] {
            assert!(square().with_seam_costs(&bad).is_err());
        }
        assert!(square().with_seam_costs(&costs[1..]).is_err());
    }

    #[test]
    fn defects_are_named() {
        let (vertices, faces) = tetrahedron();
        let build = |v: &[[f64; 3]], f: &[[i64; 3]]| TriangleMesh::new(v.to_vec(), f).unwrap_err();

        let mut bad = vertices.clone();
        bad[2][1] = f64::NAN;
        assert!(matches!(
            build(&bad, &faces),
            Error::NonFiniteVertex {
                vertex: 2,
                axis: 1,
                ..
            }
        ));
        let mut flipped = faces.clone();
        flipped[3] = [1, 3, 2];
        assert!(matches!(
            build(&vertices, &flipped),
            Error::InconsistentOrientation { .. }
        ));
        let mut fan = faces.clone();
        fan.push([0, 1, 2]);
        assert!(matches!(
            build(&vertices, &fan),
            Error::NonManifoldEdge { count: 3, .. }
        ));
        let mut extra = vertices.clone();
        extra.push([2.0; 3]);
        assert_eq!(
            build(&extra, &faces),
            Error::UnreferencedVertex { vertex: 4 }
        );
        assert!(matches!(
            build(&vertices, &[[0, 1, 1]]),
            Error::RepeatedVertex { face: 0, .. }
        ));
        assert!(matches!(
            build(&vertices, &[[0, 1, 7]]),
            Error::IndexOutOfRange { index: 7, .. }
        ));
        assert!(matches!(build(&vertices, &[]), Error::Empty { .. }));
        let line = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert!(matches!(
            build(&line, &[[0, 1, 2]]),
            Error::DegenerateFace { face: 0, .. }
        ));
        let two: Vec<_> = vertices
            .iter()
            .copied()
            .chain(vertices.iter().map(|p| [p[0] + 5.0, p[1], p[2]]))
            .collect();
        let both: Vec<_> = faces
            .iter()
            .copied()
            .chain(faces.iter().map(|f| f.map(|v| v + 4)))
            .collect();
        assert_eq!(
            build(&two, &both),
            Error::Disconnected { count: 2, face: 4 }
        );
        assert_eq!(
            TriangleMesh::pieces(two, &both).unwrap().n_boundary_loops(),
            0
        );
        let pinched = vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        assert!(matches!(
            build(&pinched, &[[0, 1, 2], [0, 3, 4]]),
            Error::NonManifoldVertex {
                vertex: 0,
                incident: 2
            }
        ));
    }
}
