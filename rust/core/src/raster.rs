//! Coverage of a texture by the triangles of a UV layout.
//!
//! A texel counts as covered where its centre lies inside a triangle; centres on an edge go to one side only
//! (the top-left rule of graphics hardware), so two triangles that share an edge never both cover a texel and
//! never leave one out. The arithmetic is exact: corners are rounded once to a grid of 2^-20 texels, and
//! everything after that is integer.

/// Fractional bits of a texel coordinate.
const SUBTEXEL_BITS: u32 = 20;
const ONE: i128 = 1 << SUBTEXEL_BITS;
/// Corners further out than this many texels are pulled in, which keeps every product inside 128 bits.
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
pub fn rasterize(uv: &[[f64; 2]], resolution: usize) -> Raster {
    let mut raster = Raster {
        face: vec![-1; resolution * resolution],
        count: vec![0; resolution * resolution],
    };
    for (index, corners) in uv.chunks_exact(3).enumerate() {
        if let Some(triangle) = Triangle::new(corners, resolution) {
            triangle.cover(resolution, |texel| {
                if raster.face[texel] < 0 {
                    raster.face[texel] = index as i32;
                }
                raster.count[texel] = raster.count[texel].saturating_add(1);
            });
        }
    }
    raster
}

/// A point on the subtexel grid: x to the right, y down.
type Point = [i128; 2];

/// A triangle with area on the subtexel grid, its interior to the right of every edge on the page.
struct Triangle([Point; 3]);

impl Triangle {
    fn new(corners: &[[f64; 2]], resolution: usize) -> Option<Self> {
        let [a, b, c] = [corners[0], corners[1], corners[2]].map(|uv| snap(uv, resolution));
        let (a, b, c) = (a?, b?, c?);
        match cross(a, b, c).signum() {
            0 => None,
            1 => Some(Self([a, b, c])),
            _ => Some(Self([a, c, b])),
        }
    }

    /// Calls `visit` with every covered texel, row by row.
    fn cover(&self, resolution: usize, mut visit: impl FnMut(usize)) {
        let Self(corners) = self;
        let (left, right) = texel_range(corners.map(|p| p[0]), resolution);
        let (top, bottom) = texel_range(corners.map(|p| p[1]), resolution);
        let edges = [0, 1, 2].map(|k| Edge::new(corners[k], corners[(k + 1) % 3]));
        for row in top..bottom {
            let mut values = edges.each_ref().map(|edge| edge.at(left, row));
            for column in left..right {
                if values.iter().all(|&value| value >= 0) {
                    visit(row * resolution + column);
                }
                for (value, edge) in values.iter_mut().zip(&edges) {
                    *value += edge.step;
                }
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
            step: -dy * ONE,
            bias: if owns_its_points { 0 } else { -1 },
        }
    }

    fn at(&self, column: usize, row: usize) -> i128 {
        let centre = [column, row].map(|k| k as i128 * ONE + ONE / 2);
        cross(self.from, self.to, centre) + self.bias
    }
}

/// Twice the signed area of a triangle, positive for clockwise corners on the page (y points down).
fn cross(a: Point, b: Point, c: Point) -> i128 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn snap(uv: [f64; 2], resolution: usize) -> Option<Point> {
    let texels = [uv[0], 1.0 - uv[1]].map(|t| t * resolution as f64);
    texels
        .iter()
        .all(|t| t.is_finite())
        .then(|| texels.map(|t| (t.clamp(-FAR, FAR) * ONE as f64).round() as i128))
}

/// The texels along one axis whose centres may lie between the extremes of three coordinates.
fn texel_range(coordinates: [i128; 3], resolution: usize) -> (usize, usize) {
    let low = coordinates.into_iter().fold(i128::MAX, i128::min);
    let high = coordinates.into_iter().fold(i128::MIN, i128::max);
    let last = resolution as i128;
    let first_centre = (low + ONE / 2 - 1).div_euclid(ONE);
    let past_centre = (high + ONE / 2).div_euclid(ONE);
    let start = first_centre.clamp(0, last) as usize;
    (start, past_centre.clamp(start as i128, last) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covered(raster: &Raster) -> usize {
        raster.count.iter().filter(|&&count| count > 0).count()
    }

    /// Numbers in [0, 1) from a linear congruential generator.
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// The unit square as a grid of cells, its inner nodes moved by `jitter` of a cell, each cell cut in two.
    fn tiling(cells: usize, jitter: f64, seed: u64) -> Vec<[f64; 2]> {
        let mut number = numbers(seed);
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
        let raster = rasterize(&[[0.0, 1.0], [0.0, 0.8], [0.2, 1.0]], 4);
        assert_eq!(covered(&raster), 0);
        let raster = rasterize(&[[0.0, 1.0], [0.0, 0.7], [0.3, 1.0]], 4);
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
            let raster = rasterize(&tiling(cells, jitter, 7), resolution);
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
        assert!(rasterize(&uv, 9).count.iter().all(|&count| count == 1));
    }

    #[test]
    fn orientation_does_not_matter() {
        let uv = tiling(9, 0.4, 3);
        let flipped: Vec<_> = uv
            .chunks_exact(3)
            .flat_map(|t| [t[0], t[2], t[1]])
            .collect();
        assert_eq!(rasterize(&uv, 50), rasterize(&flipped, 50));
    }

    #[test]
    fn overlap_is_counted_and_the_first_face_wins() {
        let one = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let raster = rasterize(&[one, one, one].concat(), 10);
        let full = raster.count.iter().filter(|&&count| count == 3).count();
        assert_eq!(full, covered(&raster));
        assert!(raster.face.iter().all(|&face| face <= 0));
        let many = one.repeat(300);
        assert_eq!(rasterize(&many, 10).count.iter().max(), Some(&255));
    }

    #[test]
    fn the_covered_share_is_the_area() {
        let raster = rasterize(&[[0.1, 0.2], [0.9, 0.31], [0.43, 0.87]], 1000);
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
        let raster = rasterize(&[point, line, outside, broken, endless].concat(), 8);
        assert_eq!(covered(&raster), 0);
    }

    #[test]
    fn triangles_are_clipped() {
        let raster = rasterize(&[[-1.0e30, -5.0], [1.0e30, -5.0], [0.5, 1.0e30]], 8);
        assert!(raster.count.iter().all(|&count| count == 1));
    }

    #[test]
    fn no_texels_is_legal() {
        assert_eq!(rasterize(&tiling(2, 0.0, 1), 0).face, Vec::<i32>::new());
    }
}
