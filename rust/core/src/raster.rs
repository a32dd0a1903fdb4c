//! Coverage of a texture by the triangles of a UV layout.
//!
//! A texel counts as covered where its centre lies inside a triangle; centres on an edge go to one side only
//! (the top-left rule of graphics hardware), so two triangles that share an edge never both cover a texel and
//! never leave one out. The arithmetic is exact: corners are rounded once to a grid of 2^-20 texels, and
//! everything after that is integer.

use std::ops::Range;

use rayon::prelude::*;

use crate::error::{Error, Result, check_length, check_parameter, try_filled};

/// Largest side of a texture in texels: an offset between two of its rows takes 16 bits.
pub const MAX_RESOLUTION: usize = 32768;
/// Rows that one task works on.
pub(crate) const STRIP: usize = 8;

/// Fractional bits of a texel coordinate.
const SUBTEXEL_BITS: u32 = 20;
const ONE: i64 = 1 << SUBTEXEL_BITS;
/// Corners further out than this many texels are pulled in, which keeps every coordinate inside 64 bits and
/// every product inside 128.
const FAR: f64 = 1.0e9;

/// What [`rasterize`] found, texel by texel, in rows from the top (v = 1) down.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Raster {
    /// Lowest index among the triangles that cover the texel; -1 where none does.
    pub face: Vec<i32>,
    /// Number of triangles that cover the texel, 255 for more.
    pub count: Vec<u8>,
}

/// Covers a square texture over [0, 1]^2 with triangles.
///
/// `uv` holds three corners per triangle, in either orientation, `resolution` the number of texels along a
/// side. Texel (row, column) has its centre at u = (column + 1/2) / resolution, v = 1 - (row + 1/2) / resolution.
/// Triangles are clipped to the texture; those without area and those with a corner that is not finite
/// cover nothing. Trailing corners that make no whole triangle are ignored.
///
/// # Examples
/// ```
/// use phaseatlas_core::raster::rasterize;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // The left half of the texture.
/// let half = [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 0.0], [0.5, 1.0], [0.0, 1.0]];
/// let raster = rasterize(&half, 4)?;
/// assert_eq!(raster.face[..4], [1, 1, -1, -1]);
/// assert_eq!(raster.count.iter().map(|&count| usize::from(count)).sum::<usize>(), 8);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// `resolution` outside 1..=[`MAX_RESOLUTION`], more triangles than indices of 31 bits hold,
/// [`Error::OutOfMemory`].
pub fn rasterize(uv: &[[f64; 2]], resolution: usize) -> Result<Raster> {
    let strips = Strips::new(uv, resolution)?;
    let mut face = try_filled("resolution", resolution * resolution, -1_i32)?;
    let mut count = try_filled("resolution", resolution * resolution, 0_u8)?;
    face.par_chunks_mut(STRIP * resolution)
        .zip(count.par_chunks_mut(STRIP * resolution))
        .enumerate()
        .for_each(|(strip, (face, count))| {
            strips.cover(strip, |triangle, texels| {
                for texel in texels {
                    if face[texel] < 0 {
                        face[texel] = triangle as i32;
                    }
                    count[texel] = count[texel].saturating_add(1);
                }
            });
        });
    Ok(Raster { face, count })
}

/// The triangle that is nearest to the viewer at each texel; -1 where there is none.
///
/// As [`rasterize`], with a height of each corner towards the viewer, three a triangle and linear in it.
/// Of triangles of equal height the first counts.
///
/// # Examples
/// ```
/// use phaseatlas_core::raster::nearest;
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// let half = [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]];
/// let whole = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
/// let face = nearest(&[half, whole].concat(), &[[1.0; 3], [0.0; 3]], 4)?;
/// assert_eq!(face[12..], [0, 0, 1, 1]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// As [`rasterize`], and other than one triple of heights a triangle.
pub fn nearest(uv: &[[f64; 2]], heights: &[[f64; 3]], resolution: usize) -> Result<Vec<i32>> {
    let strips = Strips::new(uv, resolution)?;
    check_length("heights", heights.len(), uv.len() / 3)?;
    let mut face = try_filled("resolution", resolution * resolution, -1_i32)?;
    face.par_chunks_mut(STRIP * resolution)
        .enumerate()
        .for_each(|(strip, face)| {
            let mut highest = vec![f64::NEG_INFINITY; face.len()];
            strips.cover(strip, |triangle, texels| {
                let plane = Plane::new(strips.corners(triangle), heights[triangle]);
                for texel in texels {
                    let row = strip * STRIP + texel / resolution;
                    let height = plane.at(texel % resolution, row, resolution);
                    if height > highest[texel] {
                        highest[texel] = height;
                        face[texel] = triangle as i32;
                    }
                }
            });
        });
    Ok(face)
}

/// A height that is linear over a triangle.
struct Plane {
    origin: [f64; 2],
    height: f64,
    slope: [f64; 2],
}

impl Plane {
    fn new(&[a, b, c]: &[[f64; 2]; 3], heights: [f64; 3]) -> Self {
        let (p, q) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let (s, t) = (heights[1] - heights[0], heights[2] - heights[0]);
        let area = p[0] * q[1] - p[1] * q[0];
        Self {
            origin: a,
            height: heights[0],
            slope: [(s * q[1] - t * p[1]) / area, (t * p[0] - s * q[0]) / area],
        }
    }

    /// The height at the centre of a texel.
    fn at(&self, column: usize, row: usize, resolution: usize) -> f64 {
        let side = resolution as f64;
        let (u, v) = (
            (column as f64 + 0.5) / side,
            1.0 - (row as f64 + 0.5) / side,
        );
        self.height + self.slope[0] * (u - self.origin[0]) + self.slope[1] * (v - self.origin[1])
    }
}

/// The triangles of a layout, three corners each, by the strips of [`STRIP`] rows that they may cover.
#[derive(Debug)]
pub(crate) struct Strips<Corners> {
    uv: Corners,
    resolution: usize,
    /// Those of strip `s` are `triangles[starts[s]..starts[s + 1]]`, ascending.
    starts: Vec<usize>,
    triangles: Vec<u32>,
}

impl<Corners: AsRef<[[f64; 2]]>> Strips<Corners> {
    pub(crate) fn new(uv: Corners, resolution: usize) -> Result<Self> {
        let legal = (1..=MAX_RESOLUTION).contains(&resolution);
        check_parameter("resolution", resolution as f64, legal, "in 1..32768 texels")?;
        let (corners, _) = uv.as_ref().as_chunks::<3>();
        if corners.len() > i32::MAX as usize {
            return Err(Error::TooLarge {
                n_vertices: 3 * corners.len(),
                n_faces: corners.len(),
            });
        }
        let count = resolution.div_ceil(STRIP);
        // The first of these and the one past the last; there are 4096 at most.
        let strips_of = |corners| {
            let triangle = Triangle::new(corners, resolution);
            let rows = triangle.map_or(0..0, |triangle| triangle.rows(resolution));
            if rows.is_empty() {
                return [0; 2];
            }
            [rows.start / STRIP, rows.end.div_ceil(STRIP)].map(|strip| strip as u16)
        };
        let strips: Vec<[u16; 2]> = corners.par_iter().map(strips_of).collect();
        let strips = || {
            strips
                .iter()
                .map(|&[first, end]| usize::from(first)..end.into())
        };
        let mut starts = vec![0_usize; count + 1];
        for strip in strips().flatten() {
            starts[strip + 1] += 1;
        }
        for strip in 0..count {
            starts[strip + 1] += starts[strip];
        }
        let mut triangles = vec![0; starts[count]];
        let mut cursor = starts.clone();
        for (triangle, strips) in (0..).zip(strips()) {
            for strip in strips {
                triangles[cursor[strip]] = triangle;
                cursor[strip] += 1;
            }
        }
        Ok(Self {
            uv,
            resolution,
            starts,
            triangles,
        })
    }

    pub(crate) fn resolution(&self) -> usize {
        self.resolution
    }

    /// Number of strips.
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The three corners of a triangle.
    pub(crate) fn corners(&self, triangle: usize) -> &[[f64; 2]; 3] {
        &self.uv.as_ref().as_chunks::<3>().0[triangle]
    }

    /// Calls `visit` with every triangle, ascending, and each run of texels that it covers in the
    /// strip; texels are numbered from the first one of the strip.
    pub(crate) fn cover(&self, strip: usize, mut visit: impl FnMut(usize, Range<usize>)) {
        let top = strip * STRIP;
        let bottom = self.resolution.min(top + STRIP);
        for &index in &self.triangles[self.starts[strip]..self.starts[strip + 1]] {
            let index = index as usize;
            let Some(triangle) = Triangle::new(self.corners(index), self.resolution) else {
                continue;
            };
            let rows = triangle.rows(self.resolution);
            triangle.cover(
                rows.start.max(top)..rows.end.min(bottom),
                self.resolution,
                |row, columns| {
                    let first = (row - top) * self.resolution;
                    visit(index, first + columns.start..first + columns.end);
                },
            );
        }
    }
}

/// A point on the subtexel grid: x to the right, y down.
type Point = [i64; 2];

/// A triangle with area on the subtexel grid, its interior to the right of every edge on the page.
struct Triangle([Point; 3]);

impl Triangle {
    fn new(corners: &[[f64; 2]; 3], resolution: usize) -> Option<Self> {
        let [a, b, c] = corners.map(|uv| snap(uv, resolution));
        let (a, b, c) = (a?, b?, c?);
        match cross(a, b, c).signum() {
            0 => None,
            1 => Some(Self([a, b, c])),
            _ => Some(Self([a, c, b])),
        }
    }

    /// The rows in which it may cover texels.
    fn rows(&self, resolution: usize) -> Range<usize> {
        texel_range(self.0.map(|p| p[1]), resolution)
    }

    /// Calls `visit` with each of the rows where it covers texels, and their columns.
    fn cover(
        &self,
        rows: Range<usize>,
        resolution: usize,
        mut visit: impl FnMut(usize, Range<usize>),
    ) {
        let Self(corners) = self;
        let columns = texel_range(corners.map(|p| p[0]), resolution);
        let edges = [0, 1, 2].map(|k| Edge::new(corners[k], corners[(k + 1) % 3]));
        for row in rows {
            let covered = edges
                .iter()
                .fold(columns.clone(), |columns, edge| edge.clip(row, columns));
            if !covered.is_empty() {
                visit(row, covered);
            }
        }
    }
}

/// One side of a triangle as the half-plane `at >= 0`.
struct Edge {
    from: Point,
    to: Point,
    /// Change of the value from one texel to the next in a row.
    step: i128,
    /// -1 where centres on the edge belong to the triangle on the other side.
    bias: i128,
}

impl Edge {
    fn new(from: Point, to: Point) -> Self {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let owns_its_points = dy < 0 || (dy == 0 && dx > 0);
        Self {
            from,
            to,
            step: i128::from(-dy) * i128::from(ONE),
            bias: if owns_its_points { 0 } else { -1 },
        }
    }

    fn at(&self, column: usize, row: usize) -> i128 {
        let centre = [column, row].map(|k| k as i64 * ONE + ONE / 2);
        cross(self.from, self.to, centre) + self.bias
    }

    /// Those of the columns whose centres in the row lie in the half-plane.
    fn clip(&self, row: usize, columns: Range<usize>) -> Range<usize> {
        let Range { start, end } = columns;
        let value = self.at(start, row);
        if self.step == 0 {
            return start..if value >= 0 { end } else { start };
        }
        let holds = |column: usize| value + (column - start) as i128 * self.step >= 0;
        // Rounded, the crossing is at most one column off: what counts is the exact test.
        let crossing = (-(value as f64) / self.step as f64).clamp(0.0, (end - start) as f64);
        let mut column = start + crossing as usize;
        if self.step > 0 {
            while column > start && holds(column - 1) {
                column -= 1;
            }
            while column < end && !holds(column) {
                column += 1;
            }
            column..end
        } else {
            while column > start && !holds(column - 1) {
                column -= 1;
            }
            while column < end && holds(column) {
                column += 1;
            }
            start..column
        }
    }
}

/// Twice the signed area of a triangle, positive for clockwise corners on the page (y points down).
fn cross(a: Point, b: Point, c: Point) -> i128 {
    let product = |x: i64, y: i64| i128::from(x) * i128::from(y);
    product(b[0] - a[0], c[1] - a[1]) - product(b[1] - a[1], c[0] - a[0])
}

fn snap(uv: [f64; 2], resolution: usize) -> Option<Point> {
    let texels = [uv[0], 1.0 - uv[1]].map(|t| t * resolution as f64);
    texels
        .iter()
        .all(|t| t.is_finite())
        .then(|| texels.map(|t| (t.clamp(-FAR, FAR) * ONE as f64).round() as i64))
}

/// The texels along one axis whose centres may lie between the extremes of three coordinates.
fn texel_range(coordinates: [i64; 3], resolution: usize) -> Range<usize> {
    let low = coordinates.into_iter().fold(i64::MAX, i64::min);
    let high = coordinates.into_iter().fold(i64::MIN, i64::max);
    let last = resolution as i64;
    let first_centre = (low + ONE / 2 - 1).div_euclid(ONE);
    let past_centre = (high + ONE / 2).div_euclid(ONE);
    let start = first_centre.clamp(0, last) as usize;
    start..past_centre.clamp(start as i64, last) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::numbers;

    fn covered(raster: &Raster) -> usize {
        raster.count.iter().filter(|&&count| count > 0).count()
    }

    /// Numbers in [0, 1).
    fn uniform(seed: u64) -> impl FnMut() -> f64 {
        let mut number = numbers(seed);
        move || f64::from(number()) / 2.0_f64.powi(31)
    }

    /// The unit square as a grid of cells, its inner nodes moved by `jitter` of a cell, each cell cut in two.
    fn tiling(cells: usize, jitter: f64, seed: u64) -> Vec<[f64; 2]> {
        let mut number = uniform(seed);
        let side = cells + 1;
        let mut moved = |k: usize| {
            let shift = if k == 0 || k == cells {
                0.0
            } else {
                jitter * (number() - 0.5)
            };
            (k as f64 + shift) / cells as f64
        };
        let nodes: Vec<_> = (0..side * side)
            .map(|node| [moved(node % side), moved(node / side)])
            .collect();
        let mut uv = Vec::new();
        for cell in 0..cells * cells {
            let a = (cell / cells) * side + cell % cells;
            for corner in [a, a + 1, a + side + 1, a, a + side + 1, a + side] {
                uv.push(nodes[corner]);
            }
        }
        uv
    }

    #[test]
    fn rows_run_from_the_top() {
        let raster = rasterize(&[[0.0, 1.0], [0.0, 0.8], [0.2, 1.0]], 4).unwrap();
        assert_eq!(covered(&raster), 0);
        let raster = rasterize(&[[0.0, 1.0], [0.0, 0.7], [0.3, 1.0]], 4).unwrap();
        assert_eq!(raster.face[0], 0);
        assert_eq!(covered(&raster), 1);
    }

    #[test]
    fn a_tiling_covers_every_texel_once() {
        for (cells, jitter, resolution) in [
            (1, 0.0, 16),
            (8, 0.0, 16),
            (16, 0.0, 8),
            (13, 0.4, 97),
            (40, 0.4, 64),
        ] {
            let raster = rasterize(&tiling(cells, jitter, 7), resolution).unwrap();
            assert!(
                raster.count.iter().all(|&count| count == 1),
                "{cells} cells at {resolution}"
            );
        }
    }

    #[test]
    fn a_fan_through_texel_centres_covers_every_texel_once() {
        let (centre, corners) = (
            [0.5 + 0.5 / 9.0, 0.5],
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        );
        let uv: Vec<_> = (0..4)
            .flat_map(|k| [centre, corners[k], corners[(k + 1) % 4]])
            .collect();
        assert!(
            rasterize(&uv, 9)
                .unwrap()
                .count
                .iter()
                .all(|&count| count == 1)
        );
    }

    #[test]
    fn orientation_does_not_matter() {
        let uv = tiling(9, 0.4, 3);
        let flipped: Vec<_> = uv
            .chunks_exact(3)
            .flat_map(|t| [t[0], t[2], t[1]])
            .collect();
        assert_eq!(
            rasterize(&uv, 50).unwrap(),
            rasterize(&flipped, 50).unwrap()
        );
    }

    #[test]
    fn overlap_is_counted_and_the_first_face_wins() {
        let one = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let raster = rasterize(&[one, one, one].concat(), 10).unwrap();
        assert!(raster.count.iter().all(|count| [0, 3].contains(count)));
        assert!(covered(&raster) > 0);
        assert!(raster.face.iter().all(|&face| face <= 0));
        let many = one.repeat(300);
        assert_eq!(rasterize(&many, 10).unwrap().count.iter().max(), Some(&255));
    }

    #[test]
    fn the_covered_share_is_the_area() {
        let raster = rasterize(&[[0.1, 0.2], [0.9, 0.31], [0.43, 0.87]], 1000).unwrap();
        let area = 0.5 * (0.8 * 0.67 - 0.33 * 0.11);
        let share = covered(&raster) as f64 / 1.0e6;
        assert!((share - area).abs() < 1.0e-4, "{share} for {area}");
    }

    #[test]
    fn what_has_no_area_or_lies_outside_covers_nothing() {
        let point = [[0.5, 0.5]; 3];
        let line = [[0.0, 0.5], [0.5, 0.5], [1.0, 0.5]];
        let outside = [[1.1, 1.1], [2.0, 1.1], [1.1, 2.0]];
        let broken = [[f64::NAN, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let endless = [[f64::INFINITY, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let raster = rasterize(&[point, line, outside, broken, endless].concat(), 8).unwrap();
        assert_eq!(covered(&raster), 0);
    }

    #[test]
    fn triangles_are_clipped() {
        let raster = rasterize(&[[-1.0e30, -5.0], [1.0e30, -5.0], [0.5, 1.0e30]], 8).unwrap();
        assert!(raster.count.iter().all(|&count| count == 1));
    }

    /// The texels that a triangle covers by the definition, one after the other.
    fn covered_by(corners: &[[f64; 2]; 3], resolution: usize) -> Vec<usize> {
        let Some(Triangle(p)) = Triangle::new(corners, resolution) else {
            return Vec::new();
        };
        let edges = [0, 1, 2].map(|k| Edge::new(p[k], p[(k + 1) % 3]));
        (0..resolution * resolution)
            .filter(|texel| {
                let (row, column) = (texel / resolution, texel % resolution);
                edges.iter().all(|edge| edge.at(column, row) >= 0)
            })
            .collect()
    }

    #[test]
    fn runs_hold_the_texels_inside_all_edges() {
        let mut number = uniform(5);
        for size in [0.05, 0.5, 3.0, 1.0e6] {
            for _ in 0..40 {
                let mut point = || [0.5 + size * (number() - 0.5), 0.5 + size * (number() - 0.5)];
                let corners = [point(), point(), point()];
                let raster = rasterize(&corners, 37).unwrap();
                let texels = raster.face.iter().enumerate();
                let found: Vec<usize> = texels.filter(|(_, f)| **f == 0).map(|(t, _)| t).collect();
                assert_eq!(found, covered_by(&corners, 37), "{corners:?}");
            }
        }
    }

    #[test]
    fn resolution_is_checked() {
        for resolution in [0, MAX_RESOLUTION + 1] {
            let error = rasterize(&tiling(2, 0.0, 1), resolution).unwrap_err();
            assert!(error.to_string().starts_with("resolution:"), "{error}");
        }
    }
}
