//! A piece: its triangles, its outline, and the angle at which its smallest rectangle is upright.

use std::collections::HashMap;

type Point = [f64; 2];

/// Of rectangles whose sizes are equal up to rounding, the first is taken.
const EQUAL: f64 = 1.0 - 1e-9;

/// Triangles that move together.
#[derive(Debug)]
pub(super) struct Piece {
    /// Relative to one of them, so that nothing is lost far from the origin.
    points: Vec<Point>,
    faces: Vec<[u32; 3]>,
    /// Edges that may lie on the border of the union of the triangles.
    outline: Vec<[u32; 2]>,
    /// Corners of the convex hull, counterclockwise.
    hull: Vec<Point>,
    /// Turning by it lays the smallest bounding rectangle along the axes, its long side along x.
    pub(super) upright: f64,
    /// Sides of the smallest bounding rectangle, the long one first.
    pub(super) sides: [f64; 2],
    /// Sum of the areas of the triangles.
    pub(super) area: f64,
}

/// The triangles of every piece that has some, pieces and triangles ascending.
pub(super) fn members(piece: &[i64]) -> Vec<Vec<u32>> {
    let count = piece.iter().max().map_or(0, |&last| last as usize + 1);
    let mut members = vec![Vec::new(); count];
    for (face, &piece) in piece.iter().enumerate() {
        members[piece as usize].push(face as u32);
    }
    members.retain(|faces| !faces.is_empty());
    members
}

impl Piece {
    pub(super) fn new(points: &[Point], triangles: &[[i64; 3]], faces: &[u32]) -> Self {
        let corners = || faces.iter().flat_map(|&face| triangles[face as usize]);
        let mut vertices: Vec<i64> = corners().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let origin = points[vertices[0] as usize];
        let local: Vec<Point> = vertices
            .iter()
            .map(|&vertex| minus(points[vertex as usize], origin))
            .collect();
        let index = |vertex: i64| vertices.partition_point(|&other| other < vertex) as u32;
        let faces: Vec<[u32; 3]> = faces
            .iter()
            .map(|&face| triangles[face as usize].map(index))
            .collect();
        Self::of(local, faces)
    }

    /// The piece in units of `step`, its points moved to whole ones: what is computed from it does
    /// not depend on rounding in the points.
    pub(super) fn rounded(&self, step: f64) -> Self {
        let points = self.points.iter();
        let points = points.map(|point| point.map(|x| (x / step).round()));
        Self::of(points.collect(), self.faces.clone())
    }

    /// Largest distance of a point from the first one.
    pub(super) fn reach(&self) -> f64 {
        let distances = self.points.iter().map(|point| point[0].hypot(point[1]));
        distances.fold(0.0, f64::max)
    }

    fn of(points: Vec<Point>, faces: Vec<[u32; 3]>) -> Self {
        let hull = convex_hull(&points);
        let (upright, sides) = smallest_rectangle(&hull);
        let area = faces
            .iter()
            .map(|&face| 0.5 * twice_area(&points, face).abs());
        Self {
            area: area.sum(),
            outline: outline(&points, &faces),
            points,
            faces,
            hull,
            upright,
            sides,
        }
    }

    /// Corners of the triangles, in the order in which they were given.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [Point; 3]> {
        self.faces
            .iter()
            .map(|face| face.map(|vertex| self.points[vertex as usize]))
    }

    /// Ends of the edges that may lie on the border.
    pub(super) fn outline(&self) -> impl Iterator<Item = [Point; 2]> {
        self.outline
            .iter()
            .map(|edge| edge.map(|vertex| self.points[vertex as usize]))
    }

    pub(super) fn hull(&self) -> &[Point] {
        &self.hull
    }
}

/// Edges that are not between two triangles of one orientation: all others have the piece on both
/// sides, however the map folds elsewhere.
fn outline(points: &[Point], faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    // How many triangles lie to the left and to the right of each edge, and how many are flat.
    let mut sides: HashMap<[u32; 2], (u32, u32, u32)> = HashMap::with_capacity(2 * faces.len());
    for &face in faces {
        let sign = twice_area(points, face);
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let (left, right, flat) = sides.entry([a.min(b), a.max(b)]).or_default();
            if sign == 0.0 {
                *flat += 1;
            } else if (a < b) == (sign > 0.0) {
                *left += 1;
            } else {
                *right += 1;
            }
        }
    }
    let mut outline: Vec<[u32; 2]> = sides
        .into_iter()
        .filter(|&(_, count)| count != (1, 1, 0))
        .map(|(edge, _)| edge)
        .collect();
    outline.sort_unstable();
    outline
}

fn twice_area(points: &[Point], face: [u32; 3]) -> f64 {
    let [a, b, c] = face.map(|vertex| points[vertex as usize]);
    cross(minus(b, a), minus(c, a))
}

/// Andrew's monotone chain; points on its sides are left out.
fn convex_hull(points: &[Point]) -> Vec<Point> {
    let mut sorted = points.to_vec();
    sorted.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    let mut hull: Vec<Point> = Vec::new();
    for upper in [false, true] {
        let start = hull.len();
        for k in 0..sorted.len() {
            let point = sorted[if upper { sorted.len() - 1 - k } else { k }];
            while hull.len() > start + 1 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if cross(minus(b, a), minus(point, a)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        // The last point begins the other chain.
        hull.pop();
    }
    if hull.is_empty() { sorted } else { hull }
}

/// Angle that lays the smallest bounding rectangle along the axes, and its sides, the long one first.
fn smallest_rectangle(hull: &[Point]) -> (f64, [f64; 2]) {
    let mut best = (f64::INFINITY, 0.0, [0.0; 2]);
    for k in 0..hull.len() {
        let side = minus(hull[(k + 1) % hull.len()], hull[k]);
        let angle = -side[1].atan2(side[0]);
        let [low, high] = bounds(hull, angle);
        let sides = minus(high, low);
        let size = sides[0] * sides[1];
        if size < EQUAL * best.0 {
            best = (size, angle, sides);
        }
    }
    let (_, angle, [width, height]) = best;
    if height > width {
        (angle + std::f64::consts::FRAC_PI_2, [height, width])
    } else {
        (angle, [width, height])
    }
}

/// Low and high corner of the bounding rectangle of turned points.
pub(super) fn bounds(points: &[Point], angle: f64) -> [Point; 2] {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    let (sine, cosine) = angle.sin_cos();
    for &point in points {
        let turned = turn(point, cosine, sine);
        for axis in 0..2 {
            low[axis] = low[axis].min(turned[axis]);
            high[axis] = high[axis].max(turned[axis]);
        }
    }
    [low, high]
}

pub(super) fn turn(point: Point, cosine: f64, sine: f64) -> Point {
    [
        cosine * point[0] - sine * point[1],
        sine * point[0] + cosine * point[1],
    ]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
