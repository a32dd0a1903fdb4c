//! A piece of any angle: points on its outline, its distance field, and its exact distance from
//! another.

use std::collections::HashSet;

use super::piece::{Piece, turn};

type Point = [f64; 2];

/// Samples of the distance field along the longer side of a piece.
const SAMPLES: f64 = 128.0;
/// Segments that are passed over at once where they are far away.
const BUNDLE: usize = 12;

/// Radius of pieces that are points: what turns them is divided by it.
const LEAST_RADIUS: f64 = 1e-8;

/// Where the centre of a piece lies and how the piece is turned.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub(super) at: Point,
    pub(super) angle: f64,
    pub(super) cosine: f64,
    pub(super) sine: f64,
}

impl Pose {
    pub(super) fn new(at: Point, angle: f64) -> Self {
        let (sine, cosine) = angle.sin_cos();
        Self {
            at,
            angle,
            cosine,
            sine,
        }
    }

    pub(super) fn apply(&self, point: Point) -> Point {
        let turned = turn(point, self.cosine, self.sine);
        [turned[0] + self.at[0], turned[1] + self.at[1]]
    }
}

/// A piece scaled, its centre at the origin.
#[derive(Debug)]
pub(super) struct Shape {
    /// Centre of the bounding rectangle of the piece before scaling.
    pub(super) centre: Point,
    /// Distance of its farthest point from the centre.
    pub(super) radius: f64,
    pub(super) hull: Vec<Point>,
    /// Points on the outline, the corners of the hull among them.
    pub(super) points: Vec<Point>,
    triangles: Vec<[Point; 3]>,
    bundles: Vec<Bundle>,
    field: Field,
}

/// Segments of the outline near one another, and the circle that holds them.
#[derive(Debug)]
struct Bundle {
    centre: Point,
    radius: f64,
    segments: Vec<[Point; 2]>,
}

impl Shape {
    /// The outline is sampled at `spacing`; distances are known up to `reach` outside.
    pub(super) fn new(piece: &Piece, scale: f64, spacing: f64, reach: f64) -> Self {
        let [low, high] = super::piece::bounds(piece.hull(), 0.0);
        let centre = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
        let local = |point: Point| [0, 1].map(|k| scale * (point[k] - centre[k]));
        let hull: Vec<Point> = piece.hull().iter().map(|&point| local(point)).collect();
        let outline: Vec<[Point; 2]> = piece.outline().map(|ends| ends.map(local)).collect();
        let triangles: Vec<[Point; 3]> = piece
            .triangles()
            .map(|corners| corners.map(local))
            .filter(|&[a, b, c]| cross(minus(b, a), minus(c, a)) != 0.0)
            .collect();
        let radius = hull
            .iter()
            .map(|p| p[0].hypot(p[1]))
            .fold(LEAST_RADIUS, f64::max);
        let size = [0, 1].map(|k| scale * (high[k] - low[k]));
        Self {
            centre,
            radius,
            points: sampled(&hull, &outline, spacing),
            field: Field::new(&outline, &triangles, size, reach),
            hull,
            triangles,
            bundles: bundles(outline),
        }
    }

    /// Distance from the piece, negative inside, and its gradient; none where it exceeds `most`.
    #[inline]
    pub(super) fn distance(&self, point: Point, most: f64) -> Option<(f64, Point)> {
        self.field.at(point, most)
    }

    /// Whether two pieces are at least `gap` apart, exactly, and else how far they are.
    pub(super) fn apart(&self, pose: &Pose, other: &Self, at: &Pose, gap: f64) -> Option<f64> {
        if norm(minus(pose.at, at.at)) > self.radius + other.radius + gap {
            return None;
        }
        let placed = |shape: &Self, pose: &Pose| -> Vec<Point> {
            let bundles = shape.bundles.iter();
            bundles.map(|bundle| pose.apply(bundle.centre)).collect()
        };
        let (mine, others) = (placed(self, pose), placed(other, at));
        let mut least = gap;
        for (bundle, &centre) in self.bundles.iter().zip(&mine) {
            let near = |k: usize| {
                norm(minus(centre, others[k])) < bundle.radius + other.bundles[k].radius + gap
            };
            let near: Vec<usize> = (0..others.len()).filter(|&k| near(k)).collect();
            if near.is_empty() {
                continue;
            }
            for &ends in &bundle.segments {
                let ends = ends.map(|end| pose.apply(end));
                for &k in &near {
                    for &across in &other.bundles[k].segments {
                        let across = across.map(|end| at.apply(end));
                        least = least.min(segment_distance(ends, across));
                    }
                }
            }
        }
        if least < gap {
            return Some(least);
        }
        // Outlines that do not meet: one piece inside another, or none.
        let inside =
            other.holds(at, pose.apply(self.hull[0])) || self.holds(pose, at.apply(other.hull[0]));
        inside.then_some(0.0)
    }

    fn holds(&self, pose: &Pose, point: Point) -> bool {
        let away = minus(point, pose.at);
        if norm(away) > self.radius {
            return false;
        }
        let point = turn(away, pose.cosine, -pose.sine);
        self.triangles.iter().any(|&[a, b, c]| {
            let side = |a, b| cross(minus(b, a), minus(point, a));
            let sides = [side(a, b), side(b, c), side(c, a)];
            sides.iter().all(|&x| x >= 0.0) || sides.iter().all(|&x| x <= 0.0)
        })
    }
}

/// The corners of the hull, then points along the outline, one in a cell.
fn sampled(hull: &[Point], outline: &[[Point; 2]], spacing: f64) -> Vec<Point> {
    let cell = |point: Point| point.map(|x| (2.0 * x / spacing).round() as i64);
    let mut points = hull.to_vec();
    let mut taken: HashSet<[i64; 2]> = hull.iter().map(|&point| cell(point)).collect();
    for &[a, b] in outline {
        let count = (norm(minus(b, a)) / spacing).ceil().max(1.0);
        for k in 0..=count as usize {
            let point = between(a, b, k as f64 / count);
            if taken.insert(cell(point)) {
                points.push(point);
            }
        }
    }
    points
}

fn bundles(mut outline: Vec<[Point; 2]>) -> Vec<Bundle> {
    let mut found = Vec::new();
    split(&mut outline, &mut found);
    found
}

/// Halves segments along the longer side of their bounding rectangle until they are few.
fn split(segments: &mut [[Point; 2]], found: &mut Vec<Bundle>) {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for point in segments.as_flattened() {
        for k in 0..2 {
            low[k] = low[k].min(point[k]);
            high[k] = high[k].max(point[k]);
        }
    }
    if segments.len() > BUNDLE {
        let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
        let middle = segments.len() / 2;
        segments.select_nth_unstable_by(middle, |a, b| {
            (a[0][axis] + a[1][axis]).total_cmp(&(b[0][axis] + b[1][axis]))
        });
        let (first, second) = segments.split_at_mut(middle);
        split(first, found);
        split(second, found);
    } else if !segments.is_empty() {
        let centre = between(low, high, 0.5);
        found.push(Bundle {
            centre,
            radius: norm(minus(high, centre)),
            segments: segments.to_vec(),
        });
    }
}

/// Distances at the corners of a grid.
#[derive(Debug)]
struct Field {
    low: Point,
    step: f64,
    inverse: f64,
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Field {
    fn new(outline: &[[Point; 2]], triangles: &[[Point; 3]], size: Point, reach: f64) -> Self {
        let step = (size[0].max(size[1]) + 2.0 * reach) / SAMPLES;
        let [width, height] = size.map(|x| ((x + 2.0 * reach) / step).ceil() as usize + 4);
        let low = size.map(|x| -0.5 * x - reach - 1.5 * step);
        let column = |point: Point| [0, 1].map(|k| (point[k] - low[k]) / step);
        let nearest = nearest(
            &outline.iter().map(|e| e.map(column)).collect::<Vec<_>>(),
            width,
            height,
        );
        let mut values: Vec<f32> = nearest
            .iter()
            .enumerate()
            .map(|(k, site)| {
                let node = [(k % width) as f64, (k / width) as f64];
                (step * norm(minus(node, *site))) as f32
            })
            .collect();
        let mut inside = vec![false; values.len()];
        for corners in triangles {
            fill(&corners.map(column), width, height, &mut inside);
        }
        for (value, inside) in values.iter_mut().zip(inside) {
            if inside {
                *value = -*value;
            }
        }
        Self {
            low,
            step,
            inverse: 1.0 / step,
            width,
            height,
            values,
        }
    }

    #[inline]
    fn at(&self, point: Point, most: f64) -> Option<(f64, Point)> {
        let [x, y] = [0, 1].map(|k| (point[k] - self.low[k]) * self.inverse);
        let inside =
            x >= 0.0 && y >= 0.0 && x < (self.width - 1) as f64 && y < (self.height - 1) as f64;
        if !inside {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (s, t) = (x - column as f64, y - row as f64);
        let corner = row * self.width + column;
        // No point of the cell is further from its corner than the diagonal.
        if f64::from(self.values[corner]) > most + std::f64::consts::SQRT_2 * self.step {
            return None;
        }
        let (lower, upper) = (
            &self.values[corner..corner + 2],
            &self.values[corner + self.width..corner + self.width + 2],
        );
        let [a, b, c, d] = [lower[0], lower[1], upper[0], upper[1]].map(f64::from);
        let (low, high) = (a + s * (b - a), c + s * (d - c));
        let slope = [
            ((1.0 - t) * (b - a) + t * (d - c)) * self.inverse,
            (high - low) * self.inverse,
        ];
        Some((low + t * (high - low), slope))
    }
}

/// The point of the segments nearest to each node, but for rounding to half a cell: two sweeps of
/// Danielsson's (1980) propagation.
fn nearest(segments: &[[Point; 2]], width: usize, height: usize) -> Vec<Point> {
    let far = [1e9; 2];
    let mut sites = vec![far; width * height];
    let square = |node: usize, site: Point| {
        let (x, y) = (
            (node % width) as f64 - site[0],
            (node / width) as f64 - site[1],
        );
        x * x + y * y
    };
    for &[a, b] in segments {
        let count = (4.0 * norm(minus(b, a))).ceil().max(1.0);
        for k in 0..=count as usize {
            let point = between(a, b, k as f64 / count);
            let (x, y) = (point[0] as usize, point[1] as usize);
            for node in [
                y * width + x,
                y * width + x + 1,
                (y + 1) * width + x,
                (y + 1) * width + x + 1,
            ] {
                if square(node, point) < square(node, sites[node]) {
                    sites[node] = point;
                }
            }
        }
    }
    let mut better = |node: usize, from: usize| {
        let site = sites[from];
        if square(node, site) < square(node, sites[node]) {
            sites[node] = site;
        }
    };
    for upwards in [true, false] {
        for k in 0..height {
            let y = if upwards { k } else { height - 1 - k };
            let before = if upwards {
                y.checked_sub(1)
            } else {
                Some(y + 1).filter(|&y| y < height)
            };
            let row = y * width;
            if let Some(before) = before {
                for x in 0..width {
                    for other in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                        better(row + x, before * width + other);
                    }
                }
            }
            for x in 1..width {
                better(row + x, row + x - 1);
            }
            for x in (0..width - 1).rev() {
                better(row + x, row + x + 1);
            }
        }
    }
    sites
}

/// Marks the nodes that a triangle holds.
fn fill(corners: &[Point; 3], width: usize, height: usize, inside: &mut [bool]) {
    let low = corners.iter().map(|c| c[1]).fold(f64::INFINITY, f64::min);
    let high = corners
        .iter()
        .map(|c| c[1])
        .fold(f64::NEG_INFINITY, f64::max);
    for row in low.ceil() as usize..=(high.floor() as usize).min(height - 1) {
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let t = (row as f64 - a[1]) / (b[1] - a[1]);
            if (0.0..=1.0).contains(&t) {
                let x = a[0] + t * (b[0] - a[0]);
                left = left.min(x);
                right = right.max(x);
            }
        }
        if left <= right {
            for column in left.ceil() as usize..=(right.floor() as usize).min(width - 1) {
                inside[row * width + column] = true;
            }
        }
    }
}

fn segment_distance([a, b]: [Point; 2], [c, d]: [Point; 2]) -> f64 {
    let side = |a, b, p| cross(minus(b, a), minus(p, a));
    let crosses = side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0;
    if crosses {
        return 0.0;
    }
    let point = |p: Point, a: Point, b: Point| {
        let along = minus(b, a);
        let square = along[0] * along[0] + along[1] * along[1];
        let away = minus(p, a);
        let t = if square > 0.0 {
            ((away[0] * along[0] + away[1] * along[1]) / square).clamp(0.0, 1.0)
        } else {
            0.0
        };
        norm(minus(p, between(a, b, t)))
    };
    point(a, c, d)
        .min(point(b, c, d))
        .min(point(c, a, b))
        .min(point(d, a, b))
}

fn between(a: Point, b: Point, t: f64) -> Point {
    [0, 1].map(|k| a[k] + t * (b[k] - a[k]))
}

fn norm(a: Point) -> f64 {
    (a[0] * a[0] + a[1] * a[1]).sqrt()
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
