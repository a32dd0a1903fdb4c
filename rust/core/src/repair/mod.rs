//! A manifold made of any polygons, with a map that leads back to every corner.
//!
//! Nothing is moved and nothing is lost: what cannot be part of a manifold is set aside and hangs on
//! to a face that can. Each step is one file or function:
//!
//! 1. vertices at one place are one (`weld`);
//! 2. polygons are cut into triangles (`polygon`);
//! 3. triangles without area and second copies are set aside;
//! 4. the others are joined along their edges in pairs and oriented (`sheets`);
//! 5. corners that hang together around a vertex become a vertex, so that no vertex and no edge has
//!    more than one fan or two faces.

mod polygon;
mod sheets;
mod weld;

use rayon::prelude::*;

use crate::error::{Error, Result, check_non_negative};
use crate::mesh::{self, DEGENERATE, NONE, cross, distance, dot, subtract};
use polygon::Outline;
use sheets::Sheets;

/// An oriented manifold of several components, and where it comes from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Repaired {
    /// Positions of the vertices: with a tolerance, that of the first vertex welded.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles in the order of the input, those of a polygon one after the other.
    pub faces: Vec<[u32; 3]>,
    /// First vertex of the input that each vertex was made of.
    pub source_vertex: Vec<u32>,
    /// Polygon of each face.
    pub polygon: Vec<u32>,
    /// Corner of the input at each corner of each face.
    pub corner: Vec<[u32; 3]>,
    /// Component of each face, from 0, in the order of their first faces.
    pub component: Vec<u32>,
    /// Whether a face is turned over against its polygon.
    pub flipped: Vec<bool>,
    /// Whether the edge from each corner to the next is a diagonal between two faces of a polygon.
    pub inner: Vec<[bool; 3]>,
    /// Triangles that are no faces.
    pub aside: Vec<Aside>,
    /// What was found, by kind.
    pub defects: Defects,
}

/// A triangle that is no face, because it has no area or because another one is the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aside {
    /// Its polygon.
    pub polygon: u32,
    /// Its corners.
    pub corner: [u32; 3],
    /// The face that it hangs on to; [`NONE`] where there is no face at all.
    pub host: u32,
    /// Barycentric coordinates in the host of the place of each corner.
    pub weights: [[f64; 3]; 3],
    /// Whether it is the same as the host.
    pub twin: bool,
}

/// How often each defect was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Defects {
    /// Vertices that became one with an earlier vertex at the same place.
    pub welded_vertices: usize,
    /// Vertices that no polygon uses.
    pub isolated_vertices: usize,
    /// Triangles without area.
    pub degenerate_faces: usize,
    /// Triangles on the same vertices as an earlier one, in the same winding.
    pub duplicate_faces: usize,
    /// Pairs of faces on the same vertices, in opposite windings.
    pub opposite_faces: usize,
    /// Edges of more than two faces.
    pub non_manifold_edges: usize,
    /// Vertices of several fans, though none of their edges is non-manifold or cut and none of
    /// their triangles without area.
    pub non_manifold_vertices: usize,
    /// Faces that were turned over.
    pub flipped_faces: usize,
    /// Edges that were cut to make a piece orientable.
    pub cut_edges: usize,
    /// Edges that were opened where a piece touches itself along an edge.
    pub opened_edges: usize,
    /// Boundary loops of the repaired faces.
    pub boundary_loops: usize,
    /// Components of the repaired faces.
    pub components: usize,
}

/// Makes an oriented manifold of polygons.
///
/// `corners` names the vertices of all polygons, one polygon after the other, and `sizes` the number
/// of corners of each; without, all are triangles. A polygon of less than three corners is set aside
/// as a triangle that repeats its last corner. Vertices at equal positions are one, and with a
/// positive `weld` those that are nearer than that.
///
/// # Errors
/// For a corner that names no vertex, a vertex in use whose position is not finite, sizes that are
/// negative or do not sum to the number of corners, and a negative `weld`.
///
/// # Examples
/// ```
/// use phaseatlas_core::repair::repair;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // A square, and a triangle at one of its sides that runs the other way.
/// let positions = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0]];
/// let repaired = repair(&positions, &[0, 1, 2, 3, 1, 2, 4], Some(&[4, 3]), 0.0)?;
/// assert_eq!(repaired.faces, [[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
/// assert_eq!(repaired.flipped, [false, false, true]);
/// assert_eq!(repaired.corner[2], [4, 6, 5]);
/// # Ok(())
/// # }
/// ```
pub fn repair(
    positions: &[[f64; 3]],
    corners: &[i64],
    sizes: Option<&[i64]>,
    weld: f64,
) -> Result<Repaired> {
    check_non_negative("weld", weld)?;
    let (named, used) = check_corners(positions, corners)?;
    let ends = check_sizes(sizes, corners.len())?;
    let first = weld::weld(positions, &used, weld);
    let welded: Vec<u32> = named.iter().map(|&v| first[v as usize]).collect();
    let outline = Outline {
        positions,
        vertices: &welded,
    };
    let (mut polygon, mut corner) = triangles(outline, ends.as_deref(), corners.len());
    let sorted = sort_out(positions, &welded, &corner);
    let mut aside: Vec<Aside> = sorted
        .aside
        .iter()
        .map(|&(t, twin)| Aside {
            polygon: polygon[t as usize],
            corner: corner[t as usize],
            host: twin,
            weights: [[1.0, 0.0, 0.0]; 3],
            twin: twin != NONE,
        })
        .collect();
    let mut kept = sorted.kept.iter();
    polygon.retain(|_| kept.next() == Some(&true));
    let mut kept = sorted.kept.iter();
    corner.retain(|_| kept.next() == Some(&true));
    let faces: Vec<[u32; 3]> = corner
        .iter()
        .map(|c| c.map(|c| welded[c as usize]))
        .collect();
    hang(&mut aside, positions, &welded, &faces, &polygon);

    let areas: Vec<f64> = faces
        .par_iter()
        .map(|face| {
            let p = face.map(|v| positions[v as usize]);
            let normal = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
            dot(normal, normal).sqrt()
        })
        .collect();
    let at_corners = corner
        .iter()
        .map(|c| c.map(|c| named[c as usize]))
        .collect();
    let mut sheets = Sheets::new(positions, faces, at_corners, polygon.clone(), &areas);
    let component = sheets.components(&areas);
    let degenerate_faces = aside.iter().filter(|t| !t.twin).count();
    let defects = Defects {
        isolated_vertices: used.iter().filter(|&&used| !used).count(),
        degenerate_faces,
        duplicate_faces: aside.len() - degenerate_faces,
        opposite_faces: sorted.opposite,
        flipped_faces: sheets.flipped.iter().filter(|&&flipped| flipped).count(),
        components: component.iter().max().map_or(0, |&last| last as usize + 1),
        ..sheets.defects
    };
    let mut repaired = Repaired {
        polygon,
        corner,
        component,
        aside,
        defects,
        ..Repaired::default()
    };
    repaired.assemble(&sheets, &named, positions, &first);
    repaired.inner = vec![[false; 3]; repaired.faces.len()];
    if let Some(ends) = ends {
        repaired.mark_diagonals(&sheets, &ends);
    }
    Ok(repaired)
}

impl Repaired {
    /// Makes a vertex of each fan, in the order of the input.
    fn assemble(
        &mut self,
        sheets: &Sheets<'_>,
        named: &[u32],
        positions: &[[f64; 3]],
        first: &[u32],
    ) {
        let fans = sheets.fans();
        // Corner of the sheets at place k of the triangle of the input.
        let place = |f: usize, k: usize| 3 * f + if sheets.turned[f] { (3 - k) % 3 } else { k };
        let corners = |f: usize| (0..3).map(move |k| (f, k));
        let mut source = vec![NONE; fans.len()];
        for (f, k) in (0..self.corner.len()).flat_map(corners) {
            let fan = &mut source[fans[place(f, k)] as usize];
            *fan = (*fan).min(named[self.corner[f][k] as usize]);
        }
        let mut order: Vec<(u32, u32)> = Vec::new();
        let mut number = vec![NONE; fans.len()];
        for (f, k) in (0..self.corner.len()).flat_map(corners) {
            let fan = fans[place(f, k)] as usize;
            if number[fan] == NONE {
                number[fan] = 0;
                order.push((source[fan], fan as u32));
            }
        }
        // Fans of one vertex stay in the order of their first corners.
        order.sort_by_key(|&(source, _)| source);
        for (v, &(_, fan)) in order.iter().enumerate() {
            number[fan as usize] = v as u32;
        }
        self.source_vertex = order.iter().map(|&(source, _)| source).collect();
        self.vertices = self
            .source_vertex
            .iter()
            .map(|&v| positions[first[v as usize] as usize])
            .collect();
        self.faces = (0..self.corner.len())
            .map(|f| [0, 1, 2].map(|k| number[fans[place(f, k)] as usize]))
            .collect();
        self.count_vertices(sheets, named, first);
        self.flipped.clone_from(&sheets.flipped);
        for (f, _) in self
            .flipped
            .iter()
            .enumerate()
            .filter(|(_, flipped)| **flipped)
        {
            self.faces[f].swap(1, 2);
            self.corner[f].swap(1, 2);
        }
        for triangle in &mut self.aside {
            if triangle.host != NONE && self.flipped[triangle.host as usize] {
                for weights in &mut triangle.weights {
                    weights.swap(1, 2);
                }
            }
        }
        self.defects.boundary_loops = self.boundary_loops(sheets);
    }

    /// Tells diagonals from sides of the polygons, which end at `ends`.
    fn mark_diagonals(&mut self, sheets: &Sheets<'_>, ends: &[u32]) {
        let size = |polygon: usize| ends[polygon] - polygon.checked_sub(1).map_or(0, |p| ends[p]);
        for (side, &other) in sheets.partner.iter().enumerate() {
            let f = side / 3;
            let polygon = self.polygon[f];
            if other == NONE || self.polygon[(other / 3) as usize] != polygon {
                continue;
            }
            let k = if sheets.turned[f] == sheets.flipped[f] {
                side % 3
            } else {
                2 - side % 3
            };
            let step = self.corner[f][k].abs_diff(self.corner[f][(k + 1) % 3]);
            self.inner[f][k] = step != 1 && step != size(polygon as usize) - 1;
        }
    }

    /// Counts what was welded, and what had several fans.
    fn count_vertices(&mut self, sheets: &Sheets<'_>, named: &[u32], first: &[u32]) {
        let mut explained = vec![false; first.len()];
        for &side in sheets.edges.iter().flatten() {
            for corner in [side, sheets::next(side)] {
                let v = sheets.faces[(corner / 3) as usize][(corner % 3) as usize];
                explained[v as usize] = true;
            }
        }
        // A triangle without area leaves a gap.
        for triangle in self.aside.iter().filter(|triangle| !triangle.twin) {
            for c in triangle.corner {
                explained[first[named[c as usize] as usize] as usize] = true;
            }
        }
        let mut fan = vec![NONE; first.len()];
        let mut joined: Vec<(u32, u32)> = Vec::new();
        let mut several = vec![false; first.len()];
        for (face, corner) in self.faces.iter().zip(&self.corner) {
            for (&v, &c) in face.iter().zip(corner) {
                let name = named[c as usize];
                if name != self.source_vertex[v as usize] {
                    joined.push((name, v));
                }
                let fan = &mut fan[name as usize];
                if *fan == NONE {
                    *fan = v;
                }
                several[name as usize] |= *fan != v && !explained[first[name as usize] as usize];
            }
        }
        joined.sort_unstable();
        joined.dedup();
        self.defects.welded_vertices = joined.len();
        self.defects.non_manifold_vertices = several.iter().filter(|&&several| several).count();
    }

    fn boundary_loops(&self, sheets: &Sheets<'_>) -> usize {
        let mut after = vec![NONE; self.vertices.len()];
        for (side, _) in sheets
            .partner
            .iter()
            .enumerate()
            .filter(|side| *side.1 == NONE)
        {
            let (f, k) = (side / 3, side % 3);
            // As the sheets are turned, which differs from the faces by whole components.
            let mut face = self.faces[f];
            if sheets.turned[f] != sheets.flipped[f] {
                face.swap(1, 2);
            }
            after[face[k] as usize] = face[(k + 1) % 3];
        }
        let mut loops = 0;
        for start in 0..after.len() {
            let mut v = start;
            while after[v] != NONE {
                v = std::mem::replace(&mut after[v], NONE) as usize;
                loops += usize::from(v == start);
            }
        }
        loops
    }
}

/// The corners as vertices in 32 bits, and which vertices they use.
fn check_corners(positions: &[[f64; 3]], corners: &[i64]) -> Result<(Vec<u32>, Vec<bool>)> {
    let count = positions.len();
    // A polygon has fewer triangles than corners.
    if count.max(3 * corners.len()) >= NONE as usize {
        return Err(Error::TooLarge {
            n_vertices: count,
            n_faces: corners.len(),
        });
    }
    let mut used = vec![false; count];
    let mut named = Vec::with_capacity(corners.len());
    for (position, &index) in corners.iter().enumerate() {
        if index < 0 || index as usize >= count {
            return Err(Error::Index {
                argument: "corners",
                position,
                index,
                count,
            });
        }
        used[index as usize] = true;
        named.push(index as u32);
    }
    for (index, place) in positions.iter().enumerate() {
        if let Some(&value) = place.iter().find(|x| used[index] && !x.is_finite()) {
            return Err(Error::NonFinite {
                argument: "positions",
                index,
                value,
            });
        }
    }
    Ok((named, used))
}

/// Where each polygon ends among the corners; none where all are triangles.
fn check_sizes(sizes: Option<&[i64]>, corners: usize) -> Result<Option<Vec<u32>>> {
    let Some(sizes) = sizes else {
        let rest = corners % 3;
        return if rest == 0 {
            Ok(None)
        } else {
            Err(Error::Length {
                argument: "corners",
                actual: corners,
                expected: corners + 3 - rest,
            })
        };
    };
    let mut end = 0_usize;
    let mut ends = Vec::with_capacity(sizes.len());
    for (index, &size) in sizes.iter().enumerate() {
        if size < 0 || size as usize > corners - end {
            return Err(Error::OutsideRange {
                argument: "sizes",
                index,
                value: size as f64,
                low: 0.0,
                high: (corners - end) as f64,
            });
        }
        end += size as usize;
        ends.push(end as u32);
    }
    if end != corners {
        return Err(Error::Length {
            argument: "corners",
            actual: corners,
            expected: end,
        });
    }
    Ok(Some(ends))
}

/// Cuts polygons into triangles without new vertices, as [`repair`] does.
///
/// Returns the polygon of each triangle, and its places in `corners`.
///
/// # Errors
/// As [`repair`].
pub fn triangulate(
    positions: &[[f64; 3]],
    corners: &[i64],
    sizes: &[i64],
) -> Result<(Vec<u32>, Vec<[u32; 3]>)> {
    let (named, used) = check_corners(positions, corners)?;
    let ends = check_sizes(Some(sizes), corners.len())?;
    let first = weld::weld(positions, &used, 0.0);
    let vertices: Vec<u32> = named.iter().map(|&v| first[v as usize]).collect();
    let outline = Outline {
        positions,
        vertices: &vertices,
    };
    Ok(triangles(outline, ends.as_deref(), corners.len()))
}

/// Polygon and corners of all triangles.
fn triangles(
    outline: Outline<'_>,
    ends: Option<&[u32]>,
    corners: usize,
) -> (Vec<u32>, Vec<[u32; 3]>) {
    let Some(ends) = ends else {
        let count = (corners / 3) as u32;
        return (
            (0..count).collect(),
            (0..count).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
        );
    };
    let (mut polygon, mut corner) = (Vec::new(), Vec::with_capacity(corners));
    let mut start = 0;
    for (p, &end) in ends.iter().enumerate() {
        outline.triangulate(start, end, &mut corner);
        polygon.resize(corner.len(), p as u32);
        start = end;
    }
    (polygon, corner)
}

/// Which triangles are faces.
struct Sorted {
    kept: Vec<bool>,
    /// The others, each with the face whose second copy it is.
    aside: Vec<(u32, u32)>,
    opposite: usize,
}

fn sort_out(positions: &[[f64; 3]], welded: &[u32], corner: &[[u32; 3]]) -> Sorted {
    let vertices = |t: usize| corner[t].map(|c| welded[c as usize]);
    let mut kept: Vec<bool> = (0..corner.len())
        .into_par_iter()
        .map(|t| {
            let [a, b, c] = vertices(t);
            let places = [a, b, c].map(|v| positions[v as usize]);
            a != b && b != c && c != a && mesh::is_face(places, DEGENERATE)
        })
        .collect();
    // By their vertices from the smallest on, those of either winding side by side.
    let mut keyed: Vec<([u32; 3], bool, u32)> = (0..corner.len())
        .into_par_iter()
        .filter(|&t| kept[t])
        .map(|t| {
            let mut v = vertices(t);
            let smallest = (0..3).min_by_key(|&k| v[k]).unwrap_or(0);
            v.rotate_left(smallest);
            let turned = v[1] > v[2];
            if turned {
                v.swap(1, 2);
            }
            (v, turned, t as u32)
        })
        .collect();
    keyed.par_sort_unstable();
    let mut twins = Vec::new();
    let mut opposite = 0;
    for same in keyed.chunk_by(|p, q| p.0 == q.0) {
        let mut windings = 0;
        for copies in same.chunk_by(|p, q| p.1 == q.1) {
            windings += 1;
            for copy in &copies[1..] {
                kept[copy.2 as usize] = false;
                twins.push((copy.2, copies[0].2));
            }
        }
        opposite += usize::from(windings == 2);
    }
    twins.sort_unstable();
    let mut twins = twins.into_iter().peekable();
    // Numbers of the faces among those that are kept.
    let mut number = vec![NONE; corner.len()];
    for (face, (t, _)) in kept.iter().enumerate().filter(|kept| *kept.1).enumerate() {
        number[t] = face as u32;
    }
    let aside = (0..corner.len() as u32)
        .filter(|&t| !kept[t as usize])
        .map(|t| match twins.next_if(|twin| twin.0 == t) {
            Some((_, twin)) => (t, number[twin as usize]),
            None => (t, NONE),
        })
        .collect();
    Sorted {
        kept,
        aside,
        opposite,
    }
}

/// Hangs what is set aside on to faces.
///
/// A twin has the places of its corners. A triangle without area goes to a face at its longest side
/// that has one, of its own polygon before others, and all of it to that side; else to a vertex of a
/// face; else to the first face of all. So it has no area on the face either.
fn hang(
    aside: &mut [Aside],
    positions: &[[f64; 3]],
    welded: &[u32],
    faces: &[[u32; 3]],
    polygon: &[u32],
) {
    if aside.is_empty() || faces.is_empty() {
        return;
    }
    let at_vertices = |corner: [u32; 3]| corner.map(|c| welded[c as usize]);
    let mut wanted = vec![false; positions.len()];
    for triangle in aside.iter().filter(|triangle| !triangle.twin) {
        for v in at_vertices(triangle.corner) {
            wanted[v as usize] = true;
        }
    }
    let mut face_of = vec![NONE; positions.len()];
    let mut sides: Vec<([u32; 2], u32)> = Vec::new();
    for (f, face) in faces.iter().enumerate() {
        for k in 0..3 {
            let [a, b] = [face[k], face[(k + 1) % 3]];
            if face_of[a as usize] == NONE {
                face_of[a as usize] = f as u32;
            }
            if wanted[a as usize] && wanted[b as usize] {
                sides.push(([a.min(b), a.max(b)], f as u32));
            }
        }
    }
    sides.par_sort_unstable();
    let place = |v: u32| positions[v as usize];
    for triangle in aside {
        let vertices = at_vertices(triangle.corner);
        if triangle.twin {
            let face = faces[triangle.host as usize];
            triangle.weights = vertices.map(|v| corner_of(face, v).unwrap_or_default());
            continue;
        }
        let best = (0..3)
            .filter_map(|k| {
                let [a, b] = [vertices[k], vertices[(k + 1) % 3]];
                let edge = [a.min(b), a.max(b)];
                let of_edge = &sides[sides.partition_point(|side| side.0 < edge)..];
                let first = of_edge.first().filter(|side| side.0 == edge)?;
                let own = of_edge.partition_point(|side| {
                    side.0 == edge && polygon[side.1 as usize] < triangle.polygon
                });
                let own = of_edge
                    .get(own)
                    .filter(|side| side.0 == edge && polygon[side.1 as usize] == triangle.polygon);
                let length = distance(place(a), place(b));
                Some((own.is_some(), length, own.unwrap_or(first).1, edge))
            })
            .reduce(|p, q| if (q.0, q.1) > (p.0, p.1) { q } else { p });
        if let Some((_, _, host, [a, b])) = best {
            let face = faces[host as usize];
            triangle.host = host;
            triangle.weights = vertices.map(|v| {
                corner_of(face, v).unwrap_or_else(|| {
                    let along = subtract(place(b), place(a));
                    let t = dot(subtract(place(v), place(a)), along) / dot(along, along);
                    // Lengths that underflow make no number.
                    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
                    face.map(|w| {
                        if w == a {
                            1.0 - t
                        } else if w == b {
                            t
                        } else {
                            0.0
                        }
                    })
                })
            });
        } else if let Some(&v) = vertices.iter().find(|&&v| face_of[v as usize] != NONE) {
            triangle.host = face_of[v as usize];
            let face = faces[triangle.host as usize];
            triangle.weights = [corner_of(face, v).unwrap_or_default(); 3];
        } else {
            triangle.host = 0;
        }
    }
}

/// Barycentric coordinates of a vertex of a face.
fn corner_of(face: [u32; 3], v: u32) -> Option<[f64; 3]> {
    face.contains(&v)
        .then(|| face.map(|w| if w == v { 1.0 } else { 0.0 }))
}
