//! How the faces of a mesh hang together: edges and half-edges, fans, boundary loops, components.

use petgraph::unionfind::UnionFind;
use rayon::prelude::*;

use crate::error::{Error, Result};

/// No neighbour, no half-edge: the other side of a boundary edge.
pub const NONE: u32 = u32::MAX;

/// Faces that make an edge-manifold, vertex-manifold, consistently oriented surface.
#[derive(Debug)]
pub(super) struct Topology {
    pub(super) faces: Vec<[u32; 3]>,
    pub(super) neighbours: Vec<[u32; 3]>,
    pub(super) edges: Vec<[u32; 2]>,
    pub(super) edge_half_edges: Vec<[u32; 2]>,
    pub(super) on_boundary: Vec<bool>,
    pub(super) boundary_loops: Vec<Vec<u32>>,
    pub(super) adjacency: Adjacency,
}

/// The vertices around each vertex, ascending, and the edges that lead to them: the pattern of
/// all sparse matrices of the mesh, without their diagonals.
#[derive(Debug)]
pub struct Adjacency {
    starts: Vec<usize>,
    vertices: Vec<u32>,
    edges: Vec<u32>,
}

impl Topology {
    /// Joins the faces along their edges, to one piece or, where they may be `apart`, to several.
    pub(super) fn new(n_vertices: usize, faces: Vec<[u32; 3]>, apart: bool) -> Result<Self> {
        let EdgeTable {
            edges,
            half_edges,
            neighbours,
        } = EdgeTable::new(&faces)?;
        check_fans(n_vertices, &faces, &neighbours)?;
        if !apart {
            check_connected(&neighbours)?;
        }
        let mut after = vec![NONE; n_vertices];
        for half_edges in half_edges.iter().filter(|sides| sides[1] == NONE) {
            let [a, b] = ends(&faces, half_edges[0]);
            after[a as usize] = b;
        }
        Ok(Self {
            adjacency: Adjacency::new(n_vertices, &edges),
            on_boundary: after.iter().map(|&next| next != NONE).collect(),
            boundary_loops: loops(after),
            faces,
            neighbours,
            edges,
            edge_half_edges: half_edges,
        })
    }
}

/// The vertices that a half-edge leads from and to.
pub(super) fn ends(faces: &[[u32; 3]], half_edge: u32) -> [u32; 2] {
    let (f, k) = ((half_edge / 3) as usize, (half_edge % 3) as usize);
    [faces[f][k], faces[f][(k + 1) % 3]]
}

/// The closed chains of vertices, each from its lowest one, that `after` makes.
fn loops(mut after: Vec<u32>) -> Vec<Vec<u32>> {
    let mut loops = Vec::new();
    for start in 0..after.len() {
        let mut chain = Vec::new();
        let mut v = start as u32;
        while after[v as usize] != NONE {
            chain.push(v);
            v = std::mem::replace(&mut after[v as usize], NONE);
        }
        if !chain.is_empty() {
            loops.push(chain);
        }
    }
    loops
}

/// Edges, each once, and what lies on their sides.
struct EdgeTable {
    edges: Vec<[u32; 2]>,
    half_edges: Vec<[u32; 2]>,
    neighbours: Vec<[u32; 3]>,
}

impl EdgeTable {
    fn new(faces: &[[u32; 3]]) -> Result<Self> {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * faces.len());
        for half_edge in 0..3 * faces.len() as u32 {
            let [a, b] = ends(faces, half_edge);
            sides.push(([a.min(b), a.max(b)], half_edge));
        }
        sides.par_sort_unstable();
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

impl Adjacency {
    fn new(n: usize, edges: &[[u32; 2]]) -> Self {
        let mut starts = vec![0_usize; n + 1];
        for edge in edges {
            starts[edge[0] as usize + 1] += 1;
            starts[edge[1] as usize + 1] += 1;
        }
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        let mut adjacency = Self {
            vertices: vec![0; 2 * edges.len()],
            edges: vec![0; 2 * edges.len()],
            starts,
        };
        let mut cursor = adjacency.starts.clone();
        let mut put = |from: u32, to: u32, edge: usize| {
            let entry = &mut cursor[from as usize];
            adjacency.vertices[*entry] = to;
            adjacency.edges[*entry] = edge as u32;
            *entry += 1;
        };
        // Edges are sorted, so that the lower neighbours of each vertex come first.
        for (edge, &[a, b]) in edges.iter().enumerate() {
            put(b, a, edge);
        }
        for (edge, &[a, b]) in edges.iter().enumerate() {
            put(a, b, edge);
        }
        adjacency
    }

    /// The neighbours of vertex `v` are the entries `starts()[v]..starts()[v + 1]`.
    #[must_use]
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// The neighbour of each entry.
    #[must_use]
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// The edge of each entry.
    #[must_use]
    pub fn edges(&self) -> &[u32] {
        &self.edges
    }

    /// The neighbours of a vertex, ascending, each with the edge that leads to it.
    #[must_use]
    pub fn around(&self, vertex: usize) -> impl ExactSizeIterator<Item = (usize, usize)> {
        let entries = self.starts[vertex]..self.starts[vertex + 1];
        let edges = &self.edges[entries.clone()];
        let pairs = self.vertices[entries].iter().zip(edges);
        pairs.map(|(&vertex, &edge)| (vertex as usize, edge as usize))
    }
}

/// Checks positions and indices: finite, in range, every vertex used, no face that names one twice.
pub(super) fn check_indices(vertices: &[[f64; 3]], faces: &[[i64; 3]]) -> Result<Vec<[u32; 3]>> {
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

/// Checks that the faces of each vertex form one fan.
fn check_fans(n_vertices: usize, faces: &[[u32; 3]], neighbours: &[[u32; 3]]) -> Result<()> {
    let mut incident = vec![0_usize; n_vertices];
    let mut first = vec![NONE; n_vertices];
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
    for v in 0..n_vertices {
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

fn check_connected(neighbours: &[[u32; 3]]) -> Result<()> {
    let mut components = UnionFind::<u32>::new(neighbours.len());
    let mut count = neighbours.len();
    for (f, across) in neighbours.iter().enumerate() {
        for &g in across.iter().filter(|&&g| g != NONE) {
            count -= usize::from(components.union(f as u32, g));
        }
    }
    let root = components.find(0);
    match (0..neighbours.len()).find(|&f| components.find(f as u32) != root) {
        Some(face) => Err(Error::Disconnected { count, face }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::TriangleMesh;
    use crate::testing::grid;

    #[test]
    fn neighbours_ascend() {
        let mesh = grid(5, 4, |_, _| 0.0);
        for v in 0..mesh.n_vertices() {
            let around: Vec<_> = mesh.adjacency().around(v).collect();
            assert!(around.is_sorted());
            for (w, edge) in around {
                let [a, b] = mesh.edges()[edge].map(|end| end as usize);
                assert_eq!((a, b), (v.min(w), v.max(w)));
            }
        }
    }

    #[test]
    fn boundary_loops_run_along_the_faces() {
        let mesh = grid(4, 3, |_, _| 0.0);
        let outer = [0, 1, 2, 3, 4, 9, 14, 19, 18, 17, 16, 15, 10, 5];
        assert_eq!(mesh.boundary_loops(), [outer]);
        let faces = mesh.faces().iter().map(|face| face.map(i64::from));
        let open: Vec<_> = faces.filter(|face| *face != [6, 7, 12]).collect();
        let mesh = TriangleMesh::new(mesh.vertices().to_vec(), &open).unwrap();
        assert_eq!(mesh.boundary_loops(), [&outer[..], &[6, 12, 7]]);
        assert_eq!((mesh.genus(), mesh.euler_characteristic()), (0, 0));
    }
}
