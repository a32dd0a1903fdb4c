//! Polygons in space, cut into triangles along their diagonals.
//!
//! Every corner stays a corner of a triangle, also one on a straight side: dropping it, as `earcut`
//! does, would leave a gap to the neighbours that share it.

use std::collections::VecDeque;

use robust::{Coord, orient2d};

use crate::mesh::{DEGENERATE, cross, dot, subtract};

/// Triangles whose quality differs by less than this factor are equally good: rounding does not
/// choose the diagonal of a rectangle.
const EQUAL: f64 = 1.0 + 1e-6;

/// An ear is clipped where twice its area is more than this fraction of its longest side squared:
/// far enough from what is degenerate, so that rounding of the plane does not make it so.
const EAR: f64 = 100.0 * DEGENERATE;

/// What polygons are made of: positions of the vertices, and the vertex of each corner.
#[derive(Clone, Copy)]
pub(super) struct Outline<'a> {
    pub(super) positions: &'a [[f64; 3]],
    pub(super) vertices: &'a [u32],
}

impl Outline<'_> {
    fn vertex(&self, corner: u32) -> u32 {
        self.vertices[corner as usize]
    }

    fn place(&self, corner: u32) -> [f64; 3] {
        self.positions[self.vertex(corner) as usize]
    }

    /// Cuts the polygon of the corners `start..end` into triangles of corners, in its winding.
    ///
    /// Less than three corners make one triangle that repeats the last. A corner at the vertex of
    /// the one before makes a triangle of no area with it.
    pub(super) fn triangulate(&self, start: u32, end: u32, out: &mut Vec<[u32; 3]>) {
        match end - start {
            0 => {}
            size @ 1..=3 => out.push([0, 1, 2].map(|k| start + k.min(size - 1))),
            _ => {
                let ring = self.without_repetitions(start, end, out);
                match ring.len() {
                    // All at one vertex: each but the first has made one, and one too many.
                    1 => drop(out.pop()),
                    0 | 2 => {}
                    3 => out.push([ring[0], ring[1], ring[2]]),
                    4 => out.extend(self.quad([ring[0], ring[1], ring[2], ring[3]])),
                    _ => self.many(ring, out),
                }
            }
        }
    }

    fn without_repetitions(&self, start: u32, end: u32, out: &mut Vec<[u32; 3]>) -> Vec<u32> {
        let mut ring: Vec<u32> = Vec::with_capacity((end - start) as usize);
        for corner in start..end {
            match ring.last() {
                Some(&last) if self.vertex(last) == self.vertex(corner) => {
                    let next = if corner + 1 < end { corner + 1 } else { start };
                    out.push([last, corner, next]);
                }
                _ => ring.push(corner),
            }
        }
        while ring.len() > 1 && self.vertex(ring[0]) == self.vertex(ring[ring.len() - 1]) {
            let first = ring[0];
            if let (Some(last), Some(&before)) = (ring.pop(), ring.last()) {
                out.push([before, last, first]);
            }
        }
        ring
    }

    /// The better of two diagonals: both triangles on the same side, and the worse one better.
    /// Equal ones are told apart by vertices, so that a copy of a polygon is cut the same.
    fn quad(&self, q: [u32; 4]) -> [[u32; 3]; 2] {
        let cuts = [
            [[q[0], q[1], q[2]], [q[0], q[2], q[3]]],
            [[q[0], q[1], q[3]], [q[1], q[2], q[3]]],
        ];
        let [even, odd] = cuts.map(|cut| {
            let [(a, one), (b, other)] = cut.map(|corners| {
                let p = corners.map(|corner| self.place(corner));
                let sides = [0, 1, 2].map(|k: usize| subtract(p[(k + 1) % 3], p[k]));
                let normal = cross(sides[0], sides[1]);
                let squares: f64 = sides.iter().map(|&side| dot(side, side)).sum();
                (normal, dot(normal, normal).sqrt() / squares)
            });
            let worse = one.min(other);
            if dot(a, b) > 0.0 { worse } else { worse - 1.0 }
        });
        let smallest = |a: usize, b: usize| self.vertex(q[a]).min(self.vertex(q[b]));
        let better = |a: f64, b: f64| a > b * EQUAL && a - b > DEGENERATE;
        let second = if better(even, odd) || better(odd, even) {
            odd > even
        } else {
            smallest(1, 3) < smallest(0, 2)
        };
        cuts[usize::from(second)]
    }

    /// Five corners or more, from the smallest vertex towards its smaller neighbour, so that a copy
    /// of either winding is cut the same.
    fn many(&self, mut ring: Vec<u32>, out: &mut Vec<[u32; 3]>) {
        let n = ring.len();
        let first = (0..n).min_by_key(|&k| self.vertex(ring[k])).unwrap_or(0);
        ring.rotate_left(first);
        let reversed = self.vertex(ring[n - 1]) < self.vertex(ring[1]);
        if reversed {
            ring[1..].reverse();
        }
        let from = out.len();
        match self.flatten(&ring) {
            Some(points) => {
                let vertices = ring.iter().map(|&corner| self.vertex(corner)).collect();
                let ears = Ears::new(points, vertices).clip();
                out.extend(ears.into_iter().map(|ear| ear.map(|k| ring[k])));
            }
            None => out.extend((1..n - 1).map(|k| [ring[0], ring[k], ring[k + 1]])),
        }
        if reversed {
            for triangle in &mut out[from..] {
                triangle.swap(1, 2);
            }
        }
    }

    /// The corners in the plane of Newell's normal, in which they run anticlockwise; none where the
    /// polygon has no area.
    fn flatten(&self, ring: &[u32]) -> Option<Vec<Coord<f64>>> {
        let origin = self.place(ring[0]);
        let arms: Vec<[f64; 3]> = ring
            .iter()
            .map(|&corner| subtract(self.place(corner), origin))
            .collect();
        let size = arms
            .iter()
            .flatten()
            .fold(0.0_f64, |size, x| size.max(x.abs()));
        if size == 0.0 || !size.is_finite() {
            return None;
        }
        let arms: Vec<_> = arms.iter().map(|arm| arm.map(|x| x / size)).collect();
        let mut normal = [0.0; 3];
        for (k, &arm) in arms.iter().enumerate() {
            let turn = cross(arm, arms[(k + 1) % arms.len()]);
            for axis in 0..3 {
                normal[axis] += turn[axis];
            }
        }
        let length = dot(normal, normal).sqrt();
        if length <= DEGENERATE {
            return None;
        }
        let normal = normal.map(|x| x / length);
        // The axis that is least along the normal makes the first direction of the plane.
        let flat = (0..3)
            .min_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs()))
            .unwrap_or(0);
        let mut axis = [0.0; 3];
        axis[flat] = 1.0;
        let right = cross(axis, normal);
        let length = dot(right, right).sqrt();
        let right = right.map(|x| x / length);
        let up = cross(normal, right);
        let point = |&arm: &[f64; 3]| Coord {
            x: dot(arm, right),
            y: dot(arm, up),
        };
        Some(arms.iter().map(point).collect())
    }
}

/// Ear clipping. An ear is a corner whose triangle has an area and no other corner in it; whether it
/// is one changes only with its neighbours.
struct Ears {
    points: Vec<Coord<f64>>,
    vertices: Vec<u32>,
    before: Vec<usize>,
    after: Vec<usize>,
    clipped: Vec<bool>,
    /// Corners that do not bend to the left: they alone can lie in an ear.
    reflex: Vec<bool>,
    cells: Cells,
}

impl Ears {
    fn new(points: Vec<Coord<f64>>, vertices: Vec<u32>) -> Self {
        let n = points.len();
        let mut ears = Self {
            before: (0..n).map(|k| (k + n - 1) % n).collect(),
            after: (0..n).map(|k| (k + 1) % n).collect(),
            clipped: vec![false; n],
            reflex: vec![false; n],
            cells: Cells::default(),
            points,
            vertices,
        };
        for k in 0..n {
            ears.reflex[k] = ears.bend(k) <= EAR;
        }
        let inside = (0..n).filter(|&k| ears.reflex[k]).collect();
        ears.cells = Cells::new(&ears.points, inside);
        ears
    }

    fn triangle(&self, k: usize) -> [usize; 3] {
        [self.before[k], k, self.after[k]]
    }

    /// Twice the area of the triangle of a corner over its longest side squared; negative to the
    /// right.
    fn bend(&self, k: usize) -> f64 {
        let [a, b, c] = self.triangle(k).map(|k| self.points[k]);
        let longest = [(a, b), (b, c), (c, a)]
            .map(|(p, q)| (p.x - q.x).powi(2) + (p.y - q.y).powi(2))
            .into_iter()
            .fold(0.0, f64::max);
        if longest == 0.0 {
            0.0
        } else {
            orient2d(a, b, c) / longest
        }
    }

    fn is_ear(&self, k: usize) -> bool {
        if self.reflex[k] {
            return false;
        }
        let ear = self.triangle(k);
        let [a, b, c] = ear.map(|k| self.points[k]);
        let sides = |q: Coord<f64>| [orient2d(a, b, q), orient2d(b, c, q), orient2d(c, a, q)];
        let blocks = |q: usize| {
            if ear.contains(&q) || self.clipped[q] || !self.reflex[q] {
                return false;
            }
            let at = (0..3).find(|&i| self.vertices[ear[i]] == self.vertices[q]);
            let Some(at) = at else {
                return sides(self.points[q]).iter().all(|&side| side >= 0.0);
            };
            // It touches a corner of the ear, as along the bridge to a hole: what goes on from it
            // must not run into the ear.
            [self.before[q], self.after[q]].into_iter().any(|next| {
                let sides = sides(self.points[next]);
                sides[at] > 0.0 && sides[(at + 2) % 3] > 0.0
            })
        };
        !self.cells.any([a, b, c], blocks)
    }

    fn clip(mut self) -> Vec<[usize; 3]> {
        let n = self.points.len();
        let mut ears = Vec::with_capacity(n - 2);
        let mut queue: VecDeque<[usize; 3]> = (0..n)
            .filter(|&k| self.is_ear(k))
            .map(|k| self.triangle(k))
            .collect();
        let mut some = 0;
        while ears.len() < n - 2 {
            let ear = match queue.pop_front() {
                Some(ear) if self.clipped[ear[1]] || self.triangle(ear[1]) != ear => continue,
                Some(ear) => ear,
                None => self.best(some),
            };
            let [a, b, c] = ear;
            ears.push(ear);
            self.clipped[b] = true;
            self.after[a] = c;
            self.before[c] = a;
            some = a;
            for k in [a, c] {
                self.reflex[k] = self.reflex[k] && self.bend(k) <= EAR;
                if self.is_ear(k) {
                    queue.push_back(self.triangle(k));
                }
            }
        }
        ears
    }

    /// Where the polygon crosses itself or is flat, the corner that bends most to the left.
    fn best(&self, some: usize) -> [usize; 3] {
        let (mut best, mut k) = (some, self.after[some]);
        while k != some {
            if self.bend(k) > self.bend(best) {
                best = k;
            }
            k = self.after[k];
        }
        self.triangle(best)
    }
}

/// Points by the cells of a grid with about one point a cell.
#[derive(Default)]
struct Cells {
    low: [f64; 2],
    size: f64,
    shape: [usize; 2],
    starts: Vec<usize>,
    items: Vec<usize>,
}

impl Cells {
    fn new(points: &[Coord<f64>], items: Vec<usize>) -> Self {
        if items.is_empty() {
            return Self::default();
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &k in &items {
            for (axis, x) in [points[k].x, points[k].y].into_iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        let count = (items.len() as f64).sqrt().ceil();
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        let size = if extent > 0.0 { extent / count } else { 1.0 };
        let mut cells = Self {
            low,
            size,
            shape: [0, 1].map(|axis| ((high[axis] - low[axis]) / size) as usize + 1),
            ..Self::default()
        };
        let mut keyed: Vec<(usize, usize)> = items
            .into_iter()
            .map(|k| {
                let [x, y] = cells.cell([points[k].x, points[k].y]);
                (y * cells.shape[0] + x, k)
            })
            .collect();
        keyed.sort_unstable();
        let count = cells.shape[0] * cells.shape[1];
        cells.starts = (0..=count)
            .map(|cell| keyed.partition_point(|&(key, _)| key < cell))
            .collect();
        cells.items = keyed.into_iter().map(|(_, k)| k).collect();
        cells
    }

    /// The cell of a place, or the nearest one.
    fn cell(&self, place: [f64; 2]) -> [usize; 2] {
        [0, 1].map(|axis| {
            // A cast from below 0 is 0.
            (((place[axis] - self.low[axis]) / self.size) as usize).min(self.shape[axis] - 1)
        })
    }

    /// Whether `found` holds for a point near the triangle.
    fn any(&self, triangle: [Coord<f64>; 3], found: impl Fn(usize) -> bool) -> bool {
        if self.items.is_empty() {
            return false;
        }
        let bound = |pick: fn(f64, f64) -> f64| {
            let [a, b, c] = triangle;
            self.cell([pick(pick(a.x, b.x), c.x), pick(pick(a.y, b.y), c.y)])
        };
        let (low, high) = (bound(f64::min), bound(f64::max));
        (low[1]..=high[1]).any(|y| {
            let row = y * self.shape[0];
            let items = self.starts[row + low[0]]..self.starts[row + high[0] + 1];
            self.items[items].iter().any(|&k| found(k))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of one polygon, and their areas by sign in the plane z = 0.
    fn cut(points: &[[f64; 2]], vertices: &[u32]) -> (Vec<[u32; 3]>, Vec<f64>) {
        let positions: Vec<_> = points.iter().map(|p| [p[0], p[1], 0.0]).collect();
        let outline = Outline {
            positions: &positions,
            vertices,
        };
        let mut triangles = Vec::new();
        outline.triangulate(0, vertices.len() as u32, &mut triangles);
        let areas = triangles
            .iter()
            .map(|t| {
                let p = t.map(|corner| outline.place(corner));
                0.5 * cross(subtract(p[1], p[0]), subtract(p[2], p[0]))[2]
            })
            .collect();
        (triangles, areas)
    }

    fn ring(points: &[[f64; 2]]) -> (Vec<[u32; 3]>, Vec<f64>) {
        cut(points, &(0..points.len() as u32).collect::<Vec<_>>())
    }

    /// Every triangle turns left, and together they have the area of the polygon.
    fn check(points: &[[f64; 2]]) {
        let (triangles, areas) = ring(points);
        assert_eq!(triangles.len(), points.len() - 2);
        assert!(areas.iter().all(|&area| area > 0.0), "{areas:?}");
        let n = points.len();
        let shoelace: f64 = (0..n)
            .map(|k| {
                let (p, q) = (points[k], points[(k + 1) % n]);
                0.5 * (p[0] * q[1] - p[1] * q[0])
            })
            .sum();
        assert!((areas.iter().sum::<f64>() - shoelace).abs() < 1e-12 * shoelace.max(1.0));
    }

    #[test]
    fn concave_quads_are_cut_at_the_reflex_corner() {
        let dart = [[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]];
        for first in 0..4 {
            let mut turned = dart;
            turned.rotate_left(first);
            check(&turned);
        }
    }

    #[test]
    fn the_better_diagonal_is_the_short_one_of_a_rhombus() {
        let rhombus = [[0.0, -1.0], [3.0, 0.0], [0.0, 1.0], [-3.0, 0.0]];
        assert_eq!(ring(&rhombus).0, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn combs_spirals_and_straight_sides() {
        let teeth = 40;
        let mut comb: Vec<[f64; 2]> = vec![[0.0, -1.0], [f64::from(teeth), -1.0]];
        for tooth in (0..teeth).rev() {
            comb.push([f64::from(tooth) + 1.0, 5.0]);
            comb.push([f64::from(tooth) + 0.5, 0.0]);
        }
        comb.push([0.0, 5.0]);
        check(&comb);
        let arm = |k: i32, r: f64| {
            let angle = f64::from(k) * 0.2;
            let r = r + 0.1 * angle;
            [r * angle.cos(), r * angle.sin()]
        };
        let spiral: Vec<[f64; 2]> = (0..120)
            .map(|k| arm(k, 0.7))
            .chain((0..120).rev().map(|k| arm(k, 0.4)))
            .collect();
        check(&spiral);
        let straight = [
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        check(&straight);
    }

    #[test]
    fn a_hole_at_the_end_of_a_bridge_stays_open() {
        // A square with a square hole; corners 0 and 4 of the outline are both ends of the bridge.
        let points = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
        ];
        let (triangles, areas) = cut(&points, &[0, 1, 2, 3, 0, 4, 5, 6, 7, 4]);
        assert_eq!(triangles.len(), 8);
        assert!(areas.iter().all(|&area| area > 0.0), "{areas:?}");
        assert!((areas.iter().sum::<f64>() - 12.0).abs() < 1e-12);
    }

    #[test]
    fn a_copy_of_either_winding_is_cut_the_same() {
        let points: Vec<[f64; 2]> = (0..8)
            .map(|k| {
                let (angle, r) = (
                    f64::from(k) * 0.25 * std::f64::consts::PI,
                    1.0 + f64::from(k % 2),
                );
                [r * angle.cos(), r * angle.sin()]
            })
            .collect();
        let vertices = |(triangles, _): (Vec<[u32; 3]>, Vec<f64>), ring: &[u32]| {
            let mut found: Vec<_> = triangles
                .iter()
                .map(|t| {
                    let mut t = t.map(|corner| ring[corner as usize]);
                    t.sort_unstable();
                    t
                })
                .collect();
            found.sort_unstable();
            found
        };
        for size in [4, 8] {
            let mut copy: Vec<u32> = (0..size).collect();
            let expected = vertices(cut(&points, &copy), &copy);
            for turn in 0..size {
                copy.rotate_left(1);
                if turn == 2 {
                    copy.reverse();
                }
                assert_eq!(vertices(cut(&points, &copy), &copy), expected);
            }
        }
    }

    #[test]
    fn whatever_has_no_area_is_cut_all_the_same() {
        for points in [
            vec![[1.0, 1.0]],
            vec![[0.0, 0.0], [1.0, 0.0]],
            vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [4.0, 0.0]],
            vec![[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]],
            vec![[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0], [-1.0, 1.0]],
        ] {
            let (triangles, _) = ring(&points);
            let mut corners: Vec<u32> = triangles.into_iter().flatten().collect();
            corners.sort_unstable();
            corners.dedup();
            assert_eq!(corners, (0..points.len() as u32).collect::<Vec<_>>());
        }
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let (triangles, areas) = cut(&square, &[0, 0, 1, 2, 2, 3, 0]);
        assert_eq!(triangles.len(), 5);
        assert_eq!(areas.iter().sum::<f64>(), 1.0);
        assert_eq!(cut(&square, &[2, 2, 2, 2]).1.iter().sum::<f64>(), 0.0);
    }
}
