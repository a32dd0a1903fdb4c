//! Connected components of a set of faces over the edges of the dual graph.

use petgraph::unionfind::UnionFind;
use rayon::prelude::*;

use crate::mesh::{NONE, TriangleMesh};

/// Components of a set of faces, numbered by their first face.
#[derive(Debug, Default, Clone)]
pub struct Components {
    /// Component of each face, [`NONE`] outside the set.
    pub labels: Vec<u32>,
    /// The faces by component: those of `c` are `faces[starts[c]..starts[c + 1]]`.
    pub faces: Vec<u32>,
    /// Where each component starts in `faces`, and their end.
    pub starts: Vec<usize>,
}

impl Components {
    /// Number of components.
    #[must_use]
    pub fn count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The faces of a component.
    #[must_use]
    pub fn faces_of(&self, component: usize) -> &[u32] {
        &self.faces[self.starts[component]..self.starts[component + 1]]
    }

    /// Labels the components of the faces that `same` joins across an edge: `inside(f)` says
    /// whether the face belongs to the set, `joined(f, g)` whether two neighbours of it connect.
    pub fn label(
        &mut self,
        mesh: &TriangleMesh,
        inside: impl Fn(usize) -> bool,
        joined: impl Fn(usize, usize) -> bool,
    ) {
        let m = mesh.n_faces();
        self.labels.clear();
        self.labels.resize(m, NONE);
        self.faces.clear();
        self.starts.clear();
        self.starts.push(0);
        for seed in 0..m {
            if self.labels[seed] != NONE || !inside(seed) {
                continue;
            }
            let label = self.count() as u32;
            let mut head = self.faces.len();
            self.labels[seed] = label;
            self.faces.push(seed as u32);
            while let Some(&f) = self.faces.get(head) {
                head += 1;
                for g in mesh.neighbours()[f as usize] {
                    if g != NONE
                        && self.labels[g as usize] == NONE
                        && inside(g as usize)
                        && joined(f as usize, g as usize)
                    {
                        self.labels[g as usize] = label;
                        self.faces.push(g);
                    }
                }
            }
            self.starts.push(self.faces.len());
        }
    }

    /// Drops the components for which `keep` is false.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let (mut count, mut end) = (0, 0);
        for c in 0..self.count() {
            let faces = self.starts[c]..self.starts[c + 1];
            let label = if keep(c) { count as u32 } else { NONE };
            for &f in &self.faces[faces.clone()] {
                self.labels[f as usize] = label;
            }
            if label != NONE {
                self.faces.copy_within(faces.clone(), end);
                count += 1;
                end += faces.len();
                self.starts[count] = end;
            }
        }
        self.faces.truncate(end);
        self.starts.truncate(count + 1);
    }
}

/// Components of equal labels: two neighbouring faces connect where `labels` agree.
///
/// # Examples
/// ```
/// use phaseatlas_core::TriangleMesh;
/// use phaseatlas_core::graph::label_components;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A strip of three triangles, the middle one in a label of its own.
/// let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0]];
/// let strip = TriangleMesh::new(vertices, &[[0, 1, 2], [1, 3, 2], [2, 3, 4]])?;
/// assert_eq!(label_components(&strip, &[7, 4, 7]).labels, [0, 1, 2]);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn label_components(mesh: &TriangleMesh, labels: &[i64]) -> Components {
    let mut components = Components::default();
    components.label(mesh, |_| true, |f, g| labels[f] == labels[g]);
    components
}

/// Components of triangles over common edges, numbered in the order of their first triangles, and how
/// many there are. Any number of triangles may meet at an edge, in either direction.
///
/// # Examples
/// ```
/// use phaseatlas_core::graph::edge_components;
///
/// let bow_tie = [[0, 1, 2], [2, 3, 4], [1, 0, 5]];
/// assert_eq!(edge_components(&bow_tie), (vec![0, 1, 0], 2));
/// ```
#[must_use]
pub fn edge_components(triangles: &[[i64; 3]]) -> (Vec<u32>, usize) {
    let mut sides: Vec<([i64; 2], u32)> = (0..)
        .zip(triangles)
        .flat_map(|(f, &[a, b, c])| {
            [[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], f))
        })
        .collect();
    sides.par_sort_unstable();
    let mut components = UnionFind::<u32>::new(triangles.len());
    for pair in sides.windows(2) {
        if pair[0].0 == pair[1].0 {
            components.union(pair[0].1, pair[1].1);
        }
    }
    numbered(components.into_labeling())
}

/// Labels below their number, numbered anew in the order of their first places, and how many there are.
pub(crate) fn numbered(mut labels: Vec<u32>) -> (Vec<u32>, usize) {
    let mut numbers = vec![NONE; labels.len()];
    let mut count = 0;
    for label in &mut labels {
        let number = &mut numbers[*label as usize];
        if *number == NONE {
            *number = count;
            count += 1;
        }
        *label = *number;
    }
    (labels, count as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::grid;

    #[test]
    fn stripes() {
        let mesh = grid(9, 4, |_, _| 0.0);
        let labels: Vec<i64> = mesh
            .faces()
            .iter()
            .map(|f| {
                let x = f
                    .iter()
                    .map(|&v| mesh.vertices()[v as usize][0])
                    .sum::<f64>();
                ((x * 3.0) as i64 / 3) % 2
            })
            .collect();
        let components = label_components(&mesh, &labels);
        assert_eq!(components.count(), 3);
        assert_eq!(components.faces.len(), mesh.n_faces());
        for c in 0..components.count() {
            let first = components.faces_of(c)[0] as usize;
            assert!(
                components
                    .faces_of(c)
                    .iter()
                    .all(|&f| labels[f as usize] == labels[first])
            );
        }
    }
}
