//! What keeps the sides of a closed polygon apart.

use std::collections::HashMap;

use super::dirichlet::Matrix2;
use super::polygon::Point;

/// A vertex and a side of the polygon that come close, by their places on it.
type Pair = (u32, u32);

/// A barrier (reach / distance - 1)^2 between the vertices of a closed polygon and the sides
/// nearer than the reach (Smith and Schaefer 2015). Where two are nearer at the start, half of
/// that distance is their reach.
pub(super) struct Barrier {
    /// The vertices of the polygon in order.
    boundary: Vec<u32>,
    reach: f64,
    shorter: HashMap<Pair, f64>,
    weight: f64,
}

/// A term of the barrier and its derivatives in the three vertices.
pub(super) struct Contact {
    pub vertices: [u32; 3],
    pub slope: f64,
    pub curvature: f64,
    /// Gradient of the distance.
    pub directions: [Point; 3],
}

impl Contact {
    /// Its share of the Hessian, in the vertices of places i and j.
    pub fn block(&self, i: usize, j: usize) -> Matrix2 {
        [0, 1]
            .map(|r| [0, 1].map(|c| self.curvature * self.directions[i][r] * self.directions[j][c]))
    }
}

impl Barrier {
    pub fn new(boundary: &[u32], uv: &[Point], reach: f64, weight: f64) -> Self {
        let mut barrier = Self {
            boundary: boundary.to_vec(),
            reach: 2.0 * reach,
            shorter: HashMap::new(),
            weight,
        };
        let mut shorter = HashMap::new();
        barrier.visit(uv, |pair, distance, _, _| {
            shorter.insert(pair, 0.5 * distance);
        });
        barrier.shorter = shorter;
        barrier.reach = reach;
        barrier
    }

    /// The value at some points.
    pub fn value(&self, uv: &[Point]) -> f64 {
        let mut sum = 0.0;
        self.visit(uv, |pair, distance, _, _| {
            let reach = self.reach_of(pair);
            if distance < reach {
                sum += self.weight * (reach / distance - 1.0).powi(2);
            }
        });
        sum
    }

    /// The terms that are not zero.
    pub fn contacts(&self, uv: &[Point]) -> Vec<Contact> {
        let mut contacts = Vec::new();
        self.visit(uv, |pair, distance, place, from_side| {
            let reach = self.reach_of(pair);
            if distance < reach {
                let direction = from_side.map(|x| x / distance);
                let excess = reach / distance - 1.0;
                let first = -reach / (distance * distance);
                contacts.push(Contact {
                    vertices: self.vertices(pair),
                    slope: self.weight * 2.0 * excess * first,
                    curvature: self.weight
                        * (2.0 * first * first + 4.0 * excess * reach / distance.powi(3)),
                    directions: [1.0, place - 1.0, -place].map(|c| direction.map(|x| c * x)),
                });
            }
        });
        contacts
    }

    fn reach_of(&self, pair: Pair) -> f64 {
        self.shorter
            .get(&pair)
            .map_or(self.reach, |shorter| shorter.min(self.reach))
    }

    fn vertices(&self, (p, side): Pair) -> [u32; 3] {
        let n = self.boundary.len();
        [p as usize, side as usize, (side as usize + 1) % n].map(|i| self.boundary[i])
    }

    /// Calls `visit` with each vertex and side nearer than the reach, their distance, the place of
    /// the nearest point on the side, and the way from there to the vertex; in order.
    fn visit(&self, uv: &[Point], mut visit: impl FnMut(Pair, f64, f64, Point)) {
        let n = self.boundary.len();
        let points: Vec<Point> = self.boundary.iter().map(|&v| uv[v as usize]).collect();
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in &points {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis] - self.reach);
                high[axis] = high[axis].max(p[axis] + self.reach);
            }
        }
        if !low.iter().chain(&high).all(|x| x.is_finite()) {
            return;
        }
        let cells = n.clamp(1, 256);
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) / cells as f64);
        let cell =
            |x: f64, axis: usize| (((x - low[axis]) / size[axis]).max(0.0) as usize).min(cells - 1);
        let mut places: Vec<Pair> = (0..n)
            .map(|i| {
                let [x, y] = [0, 1].map(|axis| cell(points[i][axis], axis));
                ((y * cells + x) as u32, i as u32)
            })
            .collect();
        places.sort_unstable();
        for i in 0..n {
            let (a, b) = (points[i], points[(i + 1) % n]);
            let [x, y] = [0, 1].map(|axis| {
                cell(a[axis].min(b[axis]) - self.reach, axis)
                    ..=cell(a[axis].max(b[axis]) + self.reach, axis)
            });
            for row in y {
                let first = (row * cells + x.start()) as u32;
                let last = (row * cells + x.end()) as u32;
                let begin = places.partition_point(|place| place.0 < first);
                for &(_, p) in places[begin..].iter().take_while(|place| place.0 <= last) {
                    if p as usize == i || p as usize == (i + 1) % n {
                        continue;
                    }
                    let (place, from_side) = nearest(a, b, points[p as usize]);
                    let distance = from_side[0].hypot(from_side[1]);
                    if distance < self.reach {
                        visit((p, i as u32), distance, place, from_side);
                    }
                }
            }
        }
    }
}

/// The place on a segment nearest to a point, from 0 to 1, and the way from there to the point.
fn nearest(a: Point, b: Point, p: Point) -> (f64, Point) {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let square = along[0] * along[0] + along[1] * along[1];
    let place = if square > 0.0 {
        ((to[0] * along[0] + to[1] * along[1]) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (place, [to[0] - place * along[0], to[1] - place * along[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slit square whose slit is open by 0.02 at the boundary.
    const SLIT: [Point; 7] = [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 0.49],
        [0.5, 0.5],
        [1.0, 0.51],
        [1.0, 1.0],
        [0.0, 1.0],
    ];
    const ORDER: [u32; 7] = [0, 1, 2, 3, 4, 5, 6];

    #[test]
    fn start_feels_nothing_and_half_of_it_does() {
        let barrier = Barrier::new(&ORDER, &SLIT, 0.1, 1.0);
        assert_eq!(barrier.value(&SLIT), 0.0);
        let mut closed = SLIT;
        closed[2][1] = 0.4975;
        closed[4][1] = 0.5025;
        assert!(barrier.value(&closed) > 0.5);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let barrier = Barrier::new(&ORDER, &SLIT, 0.1, 1.0);
        let mut uv = SLIT;
        uv[2] = [1.03, 0.498];
        uv[4] = [0.97, 0.502];
        let mut gradient = [[0.0; 2]; 7];
        for contact in barrier.contacts(&uv) {
            for (v, direction) in contact.vertices.into_iter().zip(contact.directions) {
                for axis in 0..2 {
                    gradient[v as usize][axis] += contact.slope * direction[axis];
                }
            }
        }
        let step = 1e-7;
        for v in 0..7 {
            for axis in 0..2 {
                let side = |sign: f64| {
                    let mut moved = uv;
                    moved[v][axis] += sign * step;
                    barrier.value(&moved)
                };
                let slope = (side(1.0) - side(-1.0)) / (2.0 * step);
                let scale = 1.0 + gradient[v][axis].abs();
                assert!((slope - gradient[v][axis]).abs() < 1e-4 * scale);
            }
        }
    }
}
