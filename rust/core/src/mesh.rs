//! A validated triangle mesh: topology, dual graph, areas, diameters, lumped mass, angle defects.

use std::f64::consts::PI;
use std::sync::OnceLock;

use petgraph::graph::UnGraph;
use petgraph::unionfind::UnionFind;

use crate::error::{Error, Result};
use crate::linear::Ordering;
use crate::operators::{LowerTriangle, StiffnessPattern};

/// No neighbour, no half-edge: the other side of a border edge.
pub const NONE: u32 = u32::MAX;

/// A face is degenerate where twice its area is below this part of its longest edge squared: the
/// area then has fewer than four digits.
const DEGENERATE: f64 = 1e-12;

/// An edge-manifold, vertex-manifold, consistently oriented, connected triangle mesh with or
/// without boundary, and the quantities of section 3 that depend on it alone.
///
/// Half-edge `3 f + k` runs from corner `k` of face `f` to corner `(k + 1) % 3`.
#[derive(Debug)]
pub struct TriangleMesh {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    neighbours: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    edge_half_edges: Vec<[u32; 2]>,
    areas: Vec<f64>,
    diameters: Vec<f64>,
    mass: Vec<f64>,
    angle_defects: Vec<f64>,
    half_cotangents: Vec<[f64; 3]>,
    on_border: Vec<bool>,
    n_boundary_loops: usize,
    pattern: StiffnessPattern,
    lower_triangle: OnceLock<LowerTriangle>,
}

impl TriangleMesh {
    /// Builds and validates the mesh.
    ///
    /// # Errors
    /// Every defect of the input is an [`Error`] that names the culprit: nothing is repaired.
    pub fn new(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Result<Self> {
        Self::build(vertices, faces, DEGENERATE)
    }

    /// Builds a mesh of faces that were accepted before, scaled or in part.
    ///
    /// Scaling rounds, so that a needle at the bound of [`Self::new`] may fall below it: here any
    /// face of positive area will do.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn accepted(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]]) -> Result<Self> {
        Self::build(vertices, faces, 0.0)
    }

    fn build(vertices: Vec<[f64; 3]>, faces: &[[i64; 3]], degenerate: f64) -> Result<Self> {
        let faces = check_indices(&vertices, faces)?;
        let edges = EdgeTable::new(&faces)?;
        let geometry = FaceGeometry::new(&vertices, &faces, degenerate)?;
        check_vertices(&vertices, &faces, &edges.neighbours)?;
        check_connected(&faces, &edges.neighbours)?;

        let n = vertices.len();
        let mut on_border = vec![false; n];
        for (edge, half_edges) in edges.edges.iter().zip(&edges.half_edges) {
            if half_edges[1] == NONE {
                on_border[edge[0] as usize] = true;
                on_border[edge[1] as usize] = true;
            }
        }
        let mut mass = vec![0.0; n];
        let mut angle_defects: Vec<f64> = on_border
            .iter()
            .map(|&border| if border { PI } else { 2.0 * PI })
            .collect();
        for (f, face) in faces.iter().enumerate() {
            for k in 0..3 {
                mass[face[k] as usize] += geometry.areas[f] / 3.0;
                angle_defects[face[k] as usize] -= geometry.angles[f][k];
            }
        }
        let n_boundary_loops = count_boundary_loops(&faces, &edges);
        let pattern = StiffnessPattern::new(n, &edges.edges);
        Ok(Self {
            vertices,
            faces,
            neighbours: edges.neighbours,
            edges: edges.edges,
            edge_half_edges: edges.half_edges,
            areas: geometry.areas,
            diameters: geometry.diameters,
            mass,
            angle_defects,
            half_cotangents: geometry.half_cotangents,
            on_border,
            n_boundary_loops,
            pattern,
            lower_triangle: OnceLock::new(),
        })
    }

    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.vertices
    }

    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    pub fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    pub fn n_faces(&self) -> usize {
        self.faces.len()
    }

    /// The edges, each once, smaller vertex first, sorted.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The one or two half-edges of every edge; [`NONE`] at the border.
    pub fn edge_half_edges(&self) -> &[[u32; 2]] {
        &self.edge_half_edges
    }

    /// The face across each half-edge; [`NONE`] at the border.
    pub fn neighbours(&self) -> &[[u32; 3]] {
        &self.neighbours
    }

    /// Face areas, sum = surface area.
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// Face diameters: the longest edge.
    pub fn diameters(&self) -> &[f64] {
        &self.diameters
    }

    /// Lumped mass of every vertex: a third of the area of its faces.
    pub fn mass(&self) -> &[f64] {
        &self.mass
    }

    /// Integrated Gauss curvature: 2 pi - sum of angles, at the border pi - sum of angles.
    pub fn angle_defects(&self) -> &[f64] {
        &self.angle_defects
    }

    /// Half the cotangent of the angle opposite to each half-edge.
    pub fn half_cotangents(&self) -> &[[f64; 3]] {
        &self.half_cotangents
    }

    pub fn on_border(&self) -> &[bool] {
        &self.on_border
    }

    pub fn n_boundary_loops(&self) -> usize {
        self.n_boundary_loops
    }

    /// The one sparsity pattern that all stiffness matrices of this mesh share.
    pub fn pattern(&self) -> &StiffnessPattern {
        &self.pattern
    }

    /// The lower triangle of the pattern with the border fixed, analysed for Cholesky
    /// factorisations at the first call.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn lower_triangle(&self) -> Result<&LowerTriangle> {
        match self.lower_triangle.get() {
            Some(lower_triangle) => Ok(lower_triangle),
            None => {
                let lower_triangle =
                    LowerTriangle::new(&self.pattern, &self.on_border, Ordering::LeastWork)?;
                Ok(self.lower_triangle.get_or_init(|| lower_triangle))
            }
        }
    }

    pub fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    /// V - E + F.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices.len() as i64 - self.edges.len() as i64 + self.faces.len() as i64
    }

    /// Genus of the surface after its boundary loops are capped.
    pub fn genus(&self) -> i64 {
        (2 - self.euler_characteristic() - self.n_boundary_loops as i64) / 2
    }

    pub fn mean_edge_length(&self) -> f64 {
        let total: f64 = self
            .edges
            .iter()
            .map(|&[a, b]| distance(self.vertices[a as usize], self.vertices[b as usize]))
            .sum();
        total / self.edges.len() as f64
    }

    /// The dual graph: one node a face, one edge an interior edge of the mesh, which it carries
    /// as its index into [`Self::edges`].
    pub fn dual_graph(&self) -> UnGraph<(), u32> {
        let mut graph = UnGraph::with_capacity(self.n_faces(), self.edges.len());
        for _ in 0..self.n_faces() {
            graph.add_node(());
        }
        for (e, half_edges) in self.edge_half_edges.iter().enumerate() {
            if half_edges[1] != NONE {
                graph.add_edge(
                    (half_edges[0] / 3).into(),
                    (half_edges[1] / 3).into(),
                    e as u32,
                );
            }
        }
        graph
    }

    /// Mean of a vertex quantity over the corners of face `f`.
    #[inline]
    pub(crate) fn face_mean(&self, values: &[f64], f: usize) -> f64 {
        let [a, b, c] = self.faces[f];
        (values[a as usize] + values[b as usize] + values[c as usize]) / 3.0
    }
}

fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = subtract(a, b);
    dot(d, d).sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn check_indices(vertices: &[[f64; 3]], faces: &[[i64; 3]]) -> Result<Vec<[u32; 3]>> {
    if vertices.is_empty() {
        return Err(Error::Empty {
            argument: "vertices",
        });
    }
    if faces.is_empty() {
        return Err(Error::Empty { argument: "faces" });
    }
    for (vertex, position) in vertices.iter().enumerate() {
        if let Some(axis) = position.iter().position(|x| !x.is_finite()) {
            return Err(Error::NonFiniteVertex {
                vertex,
                axis,
                value: position[axis],
            });
        }
    }
    let n_vertices = vertices.len();
    if n_vertices.max(3 * faces.len()) >= NONE as usize {
        return Err(Error::TooLarge {
            n_vertices,
            n_faces: faces.len(),
        });
    }
    let mut referenced = vec![false; n_vertices];
    let mut checked = Vec::with_capacity(faces.len());
    for (face, corners) in faces.iter().enumerate() {
        if let Some(&index) = corners
            .iter()
            .find(|&&index| index < 0 || index as usize >= n_vertices)
        {
            return Err(Error::IndexOutOfRange {
                face,
                index,
                n_vertices,
            });
        }
        let corners = corners.map(|index| index as u32);
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            return Err(Error::RepeatedVertex {
                face,
                vertices: corners,
            });
        }
        for corner in corners {
            referenced[corner as usize] = true;
        }
        checked.push(corners);
    }
    match referenced.iter().position(|&used| !used) {
        Some(vertex) => Err(Error::UnreferencedVertex { vertex }),
        None => Ok(checked),
    }
}

struct EdgeTable {
    edges: Vec<[u32; 2]>,
    half_edges: Vec<[u32; 2]>,
    neighbours: Vec<[u32; 3]>,
}

impl EdgeTable {
    fn new(faces: &[[u32; 3]]) -> Result<Self> {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * faces.len());
        for (f, face) in faces.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                sides.push(([a.min(b), a.max(b)], (3 * f + k) as u32));
            }
        }
        sides.sort_unstable();
        let mut edges = Vec::with_capacity(sides.len() / 2 + 1);
        let mut half_edges = Vec::with_capacity(sides.len() / 2 + 1);
        let mut neighbours = vec![[NONE; 3]; faces.len()];
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            let edge = group[0].0;
            let face = |i: usize| (group[i].1 / 3) as usize;
            let slot = |i: usize| (group[i].1 % 3) as usize;
            edges.push(edge);
            match group.len() {
                1 => half_edges.push([group[0].1, NONE]),
                2 => {
                    if faces[face(0)][slot(0)] == faces[face(1)][slot(1)] {
                        return Err(Error::InconsistentOrientation {
                            edge,
                            faces: [face(0), face(1)],
                        });
                    }
                    neighbours[face(0)][slot(0)] = face(1) as u32;
                    neighbours[face(1)][slot(1)] = face(0) as u32;
                    half_edges.push([group[0].1, group[1].1]);
                }
                count => {
                    return Err(Error::NonManifoldEdge {
                        edge,
                        count,
                        faces: [face(0), face(1), face(2)],
                    });
                }
            }
        }
        Ok(Self {
            edges,
            half_edges,
            neighbours,
        })
    }
}

struct FaceGeometry {
    areas: Vec<f64>,
    diameters: Vec<f64>,
    angles: Vec<[f64; 3]>,
    half_cotangents: Vec<[f64; 3]>,
}

impl FaceGeometry {
    fn new(vertices: &[[f64; 3]], faces: &[[u32; 3]], degenerate: f64) -> Result<Self> {
        let m = faces.len();
        let mut geometry = Self {
            areas: Vec::with_capacity(m),
            diameters: Vec::with_capacity(m),
            angles: Vec::with_capacity(m),
            half_cotangents: Vec::with_capacity(m),
        };
        for (face, corners) in faces.iter().enumerate() {
            let p = corners.map(|v| vertices[v as usize]);
            let normal = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
            let double_area = dot(normal, normal).sqrt();
            let diameter = (0..3)
                .map(|k| distance(p[k], p[(k + 1) % 3]))
                .fold(0.0, f64::max);
            // Huge coordinates overflow to infinity or NaN.
            if double_area.is_nan()
                || double_area <= degenerate * diameter * diameter
                || double_area.is_infinite()
            {
                return Err(Error::DegenerateFace {
                    face,
                    vertices: *corners,
                    area: 0.5 * double_area,
                    diameter,
                });
            }
            let cosine = [0, 1, 2].map(|k: usize| {
                let apex = p[k];
                dot(
                    subtract(p[(k + 1) % 3], apex),
                    subtract(p[(k + 2) % 3], apex),
                )
            });
            geometry.areas.push(0.5 * double_area);
            geometry.diameters.push(diameter);
            geometry.angles.push(cosine.map(|c| double_area.atan2(c)));
            geometry
                .half_cotangents
                .push([0, 1, 2].map(|k: usize| 0.5 * cosine[(k + 2) % 3] / double_area));
        }
        Ok(geometry)
    }
}

/// Checks that the faces of each vertex form one fan.
fn check_vertices(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    neighbours: &[[u32; 3]],
) -> Result<()> {
    let mut incident = vec![0_usize; vertices.len()];
    let mut first = vec![NONE; vertices.len()];
    for (f, face) in faces.iter().enumerate() {
        for &v in face {
            incident[v as usize] += 1;
            first[v as usize] = f as u32;
        }
    }
    let corner = |f: u32, v: usize| -> usize {
        let face = faces[f as usize];
        (0..3).find(|&k| face[k] as usize == v).unwrap_or(0)
    };
    for v in 0..vertices.len() {
        let start = first[v];
        let mut seen = 0;
        let mut f = start;
        let mut closed = false;
        while f != NONE {
            seen += 1;
            f = neighbours[f as usize][(corner(f, v) + 2) % 3];
            if f == start {
                closed = true;
                break;
            }
        }
        if !closed {
            f = neighbours[start as usize][corner(start, v)];
            while f != NONE {
                seen += 1;
                f = neighbours[f as usize][corner(f, v)];
            }
        }
        if seen != incident[v] {
            return Err(Error::NonManifoldVertex {
                vertex: v,
                incident: incident[v],
            });
        }
    }
    Ok(())
}

fn check_connected(faces: &[[u32; 3]], neighbours: &[[u32; 3]]) -> Result<()> {
    let mut sets = UnionFind::<u32>::new(faces.len());
    let mut count = faces.len();
    for (f, across) in neighbours.iter().enumerate() {
        for &g in across.iter().filter(|&&g| g != NONE) {
            count -= usize::from(sets.union(f as u32, g));
        }
    }
    let root = sets.find(0);
    match (0..faces.len()).find(|&f| sets.find(f as u32) != root) {
        Some(face) => Err(Error::Disconnected { count, face }),
        None => Ok(()),
    }
}

fn count_boundary_loops(faces: &[[u32; 3]], edges: &EdgeTable) -> usize {
    let mut next = std::collections::BTreeMap::new();
    for half_edges in edges.half_edges.iter().filter(|h| h[1] == NONE) {
        let (f, k) = ((half_edges[0] / 3) as usize, (half_edges[0] % 3) as usize);
        next.insert(faces[f][k], faces[f][(k + 1) % 3]);
    }
    let mut loops = 0;
    while let Some((&start, _)) = next.iter().next() {
        let mut v = start;
        while let Some(w) = next.remove(&v) {
            v = w;
        }
        loops += 1;
    }
    loops
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A regular grid of nx x ny squares on [0, 1]^2, lifted by `height`.
    pub(crate) fn grid(nx: usize, ny: usize, height: impl Fn(f64, f64) -> f64) -> TriangleMesh {
        let mut vertices = Vec::new();
        for j in 0..=ny {
            for i in 0..=nx {
                let (x, y) = (i as f64 / nx as f64, j as f64 / ny as f64);
                vertices.push([x, y, height(x, y)]);
            }
        }
        let mut faces = Vec::new();
        let index = |i: usize, j: usize| (j * (nx + 1) + i) as i64;
        for j in 0..ny {
            for i in 0..nx {
                faces.push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
                faces.push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
            }
        }
        TriangleMesh::new(vertices, &faces).expect("a grid is a valid mesh")
    }

    /// A torus of radii 1 and `minor`.
    pub(crate) fn torus(n_major: usize, n_minor: usize, minor: f64) -> TriangleMesh {
        let mut vertices = Vec::new();
        for i in 0..n_major {
            let a = 2.0 * PI * i as f64 / n_major as f64;
            for j in 0..n_minor {
                let b = 2.0 * PI * j as f64 / n_minor as f64;
                let r = 1.0 + minor * b.cos();
                vertices.push([r * a.cos(), r * a.sin(), minor * b.sin()]);
            }
        }
        let index = |i: usize, j: usize| ((i % n_major) * n_minor + j % n_minor) as i64;
        let mut faces = Vec::new();
        for i in 0..n_major {
            for j in 0..n_minor {
                faces.push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
                faces.push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
            }
        }
        TriangleMesh::new(vertices, &faces).expect("a torus is a valid mesh")
    }

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
        assert_eq!(mesh.dual_graph().edge_count(), mesh.edges().len() - 26);
    }

    #[test]
    fn closed_surface() {
        let (vertices, faces) = tetrahedron();
        let mesh = TriangleMesh::new(vertices, &faces).unwrap();
        assert_eq!((mesh.genus(), mesh.n_boundary_loops()), (0, 0));
        assert!((mesh.angle_defects().iter().sum::<f64>() - 4.0 * PI).abs() < 1e-12);
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
