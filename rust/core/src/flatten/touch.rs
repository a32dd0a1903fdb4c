//! Closed polygons that touch themselves up to rounding: both banks of a cut through a flat part of a
//! chart come to lie on each other.

use super::polygon::{Point, turn};

/// How far a crossing reaches where it may be a touch, relative to the extent of the polygon; the
/// rounding of a boundary of a thousand sides is a thousand times less.
const TOUCH: f64 = 1e-9;
/// Distance from a touch at which the polygon is to cover the plane at most once. Less than what single
/// precision tells apart.
const AROUND: f64 = 1e-7;
/// Directions in which it is looked at there.
const DIRECTIONS: usize = 16;

/// Whether the closed polygon, which runs counterclockwise, crosses itself nowhere by more than
/// rounding, and covers no place near a touch twice or from behind.
pub(crate) fn only_touches(points: &[Point]) -> bool {
    let n = points.len();
    let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
    let high = |axis: usize| {
        points
            .iter()
            .map(|p| p[axis])
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let extent = (high(0) - low(0)).max(high(1) - low(1));
    if !(extent > 0.0 && extent.is_finite()) {
        return false;
    }
    let ends = |i: usize| [points[i], points[(i + 1) % n]];
    let span = |i: usize, axis: usize| {
        let [p, q] = ends(i);
        (p[axis].min(q[axis]), p[axis].max(q[axis]))
    };
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_unstable_by(|&i, &j| span(i, 0).0.total_cmp(&span(j, 0).0).then(i.cmp(&j)));
    let reach = TOUCH * extent;
    let mut touches = Vec::new();
    for (k, &i) in order.iter().enumerate() {
        for &j in &order[k + 1..] {
            if span(j, 0).0 > span(i, 0).1 {
                break;
            }
            let neighbours = (i + 1) % n == j || (j + 1) % n == i;
            if neighbours || span(j, 1).0 > span(i, 1).1 || span(i, 1).0 > span(j, 1).1 {
                continue;
            }
            match Contact::of(ends(i), ends(j), reach) {
                Contact::Apart => (),
                Contact::Crossing => return false,
                Contact::Touch(place) => touches.push(place),
            }
        }
    }
    let around = AROUND * extent;
    touches.iter().all(|place| {
        (0..DIRECTIONS).all(|k| {
            let (sin, cos) =
                (std::f64::consts::TAU * (k as f64 + 0.5) / DIRECTIONS as f64).sin_cos();
            let at = [place[0] + around * cos, place[1] + around * sin];
            (0..=1).contains(&winding_number(points, at))
        })
    })
}

enum Contact {
    Apart,
    Crossing,
    /// The end of one that is nearest to the other.
    Touch(Point),
}

impl Contact {
    fn of([a, b]: [Point; 2], [c, d]: [Point; 2], reach: f64) -> Self {
        let length = |p: Point, q: Point| (q[0] - p[0]).hypot(q[1] - p[1]);
        let sides = [
            (a, turn(c, d, a), length(c, d)),
            (b, turn(c, d, b), length(c, d)),
            (c, turn(a, b, c), length(a, b)),
            (d, turn(a, b, d), length(a, b)),
        ];
        let one_side = |x: f64, y: f64| (x > 0.0 && y > 0.0) || (x < 0.0 && y < 0.0);
        if one_side(sides[0].1, sides[1].1) || one_side(sides[2].1, sides[3].1) {
            return Self::Apart;
        }
        let mut nearest = (f64::INFINITY, a);
        for (end, area, base) in sides {
            if area.abs() < nearest.0 * base {
                nearest = (area.abs() / base, end);
            }
        }
        if nearest.0 > reach {
            Self::Crossing
        } else {
            Self::Touch(nearest.1)
        }
    }
}

fn winding_number(points: &[Point], at: Point) -> i32 {
    let mut winding = 0;
    for (i, &p) in points.iter().enumerate() {
        let q = points[(i + 1) % points.len()];
        if (p[1] <= at[1]) != (q[1] <= at[1]) {
            let side = turn(p, q, at);
            if q[1] > p[1] && side > 0.0 {
                winding += 1;
            } else if q[1] < p[1] && side < 0.0 {
                winding -= 1;
            }
        }
    }
    winding
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slit_is_a_touch() {
        // A square with a slit from the middle of its lower side, whose banks differ by rounding.
        for noise in [0.0, 1e-13, -1e-13] {
            let points = [
                [0.0, 0.0],
                [0.5, 0.0],
                [0.5 + noise, 0.25],
                [0.5, 0.5],
                [0.5 - noise, 0.25],
                [0.5, 0.0],
                [1.0, 0.0],
                [1.0, 1.0],
                [0.0, 1.0],
            ];
            assert!(only_touches(&points), "{noise}");
        }
    }

    #[test]
    fn a_crossing_through_a_corner_is_none() {
        // The corner (1, 0) lies on the first side, and the boundary goes on beyond it.
        let through = [
            [0.0, 0.0],
            [2.0, 0.0],
            [2.0, 1.0],
            [1.0, 0.0],
            [0.5, -1.0],
            [-1.0, -1.0],
        ];
        assert!(!only_touches(&through));
        let back = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(only_touches(&back));
    }

    #[test]
    fn a_crossing_is_no_touch() {
        let eight = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(!only_touches(&eight));
        let twice = [
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
        ];
        assert!(!only_touches(&twice));
    }
}
