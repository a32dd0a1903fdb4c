//! Closed polygons in the plane: whether one crosses itself, and how much it covers twice.

use robust::{Coord, orient2d};

/// A point of the plane.
pub(crate) type Point = [f64; 2];

/// Lines along which the area covered twice is measured.
const SCAN_LINES: usize = 256;

fn coord(p: Point) -> Coord<f64> {
    Coord { x: p[0], y: p[1] }
}

/// Sign of the turn a, b, c, exact for the given numbers; positive to the left.
pub(crate) fn turn(a: Point, b: Point, c: Point) -> f64 {
    orient2d(coord(a), coord(b), coord(c))
}

/// Least and greatest coordinates.
fn extent(points: &[Point]) -> [Point; 2] {
    let mut box_ = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for p in points {
        for axis in 0..2 {
            box_[0][axis] = box_[0][axis].min(p[axis]);
            box_[1][axis] = box_[1][axis].max(p[axis]);
        }
    }
    box_
}

/// Whether no two sides of the closed polygon meet but neighbours in their common corner. Exact.
pub(crate) fn is_simple(points: &[Point]) -> bool {
    let n = points.len() as u32;
    let sides: Vec<[u32; 2]> = (0..n).map(|i| [i, (i + 1) % n]).collect();
    are_apart(points, &sides)
}

/// Whether no two sides, each between two of the points, meet but in a common corner. Exact.
pub(crate) fn are_apart(points: &[Point], sides: &[[u32; 2]]) -> bool {
    let ends = |side: usize| sides[side].map(|p| points[p as usize]);
    let corners: Vec<Point> = sides
        .iter()
        .map(|side| points[side[0] as usize])
        .chain(sides.iter().map(|side| points[side[1] as usize]))
        .collect();
    let [low, high] = extent(&corners);
    let cells = ((sides.len() as f64).sqrt().ceil() as usize).clamp(1, 512);
    let size = [0, 1].map(|axis| (high[axis] - low[axis]).max(f64::MIN_POSITIVE) / cells as f64);
    if !size.iter().chain(&low).all(|x| x.is_finite()) {
        return sides.is_empty();
    }
    let cell = |x: f64, axis: usize| (((x - low[axis]) / size[axis]) as usize).min(cells - 1);
    let mut places: Vec<(u32, u32)> = Vec::with_capacity(3 * sides.len());
    for i in 0..sides.len() {
        let [p, q] = ends(i);
        let [x, y] =
            [0, 1].map(|axis| cell(p[axis].min(q[axis]), axis)..=cell(p[axis].max(q[axis]), axis));
        for row in y {
            for column in x.clone() {
                places.push(((row * cells + column) as u32, i as u32));
            }
        }
    }
    places.sort_unstable();
    places.chunk_by(|a, b| a.0 == b.0).all(|group| {
        group.iter().enumerate().all(|(k, &(_, i))| {
            group[k + 1..].iter().all(|&(_, j)| {
                let [[a, b], [c, d]] = [sides[i as usize], sides[j as usize]];
                let at = |p: u32| points[p as usize];
                let apart = |common: u32, p: u32, q: u32| !is_spike(at(common), at(p), at(q));
                match (a == c, a == d, b == c, b == d) {
                    (false, false, false, false) => !meet(at(a), at(b), at(c), at(d)),
                    (true, _, _, false) => apart(a, b, d),
                    (_, true, false, _) => apart(a, b, c),
                    (_, false, true, _) => apart(b, a, d),
                    (false, _, _, true) => apart(b, a, c),
                    _ => false,
                }
            })
        })
    })
}

/// Whether p and q lie in the same direction from `corner`.
fn is_spike(corner: Point, p: Point, q: Point) -> bool {
    turn(corner, p, q) == 0.0
        && (0..2).any(|axis| (p[axis] - corner[axis]) * (q[axis] - corner[axis]) > 0.0)
}

/// Whether two closed segments have a point in common.
fn meet(a: Point, b: Point, c: Point, d: Point) -> bool {
    for axis in 0..2 {
        if a[axis].max(b[axis]) < c[axis].min(d[axis])
            || c[axis].max(d[axis]) < a[axis].min(b[axis])
        {
            return false;
        }
    }
    let splits = |s: f64, t: f64| !(s > 0.0 && t > 0.0 || s < 0.0 && t < 0.0);
    splits(turn(a, b, c), turn(a, b, d)) && splits(turn(c, d, a), turn(c, d, b))
}

/// Area that the closed polygon covers more than once, each time counted, and that it covers
/// from behind, along [`SCAN_LINES`] lines: the integral of max(w - 1, -w, 0), w the winding number.
pub(crate) fn covered_twice(points: &[Point]) -> f64 {
    let n = points.len();
    let [low, high] = extent(points);
    let spacing = (high[1] - low[1]) / SCAN_LINES as f64;
    if !(spacing > 0.0 && spacing.is_finite()) {
        return 0.0;
    }
    let line = |y: f64| (y - low[1]) / spacing - 0.5;
    let mut crossings: Vec<(u32, f64, i32)> = Vec::with_capacity(8 * SCAN_LINES);
    for i in 0..n {
        let (p, q) = (points[i], points[(i + 1) % n]);
        // Going down is the left side of a polygon that runs counterclockwise.
        let (bottom, top, change) = if p[1] < q[1] { (p, q, -1) } else { (q, p, 1) };
        let first = line(bottom[1]).ceil().max(0.0) as usize;
        let end = (line(top[1]).ceil().max(0.0) as usize).min(SCAN_LINES);
        for k in first..end {
            let y = low[1] + (k as f64 + 0.5) * spacing;
            let t = (y - bottom[1]) / (top[1] - bottom[1]);
            crossings.push((k as u32, bottom[0] + t * (top[0] - bottom[0]), change));
        }
    }
    crossings.sort_unstable_by(|a, b| (a.0.cmp(&b.0)).then(a.1.total_cmp(&b.1)));
    let mut total = 0.0;
    let mut winding = 0;
    for pair in crossings.windows(2) {
        winding += pair[0].2;
        if pair[0].0 == pair[1].0 {
            total += f64::from((winding - 1).max(-winding).max(0)) * (pair[1].1 - pair[0].1);
        } else {
            winding = 0;
        }
    }
    total * spacing
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn circle(n: usize, turns: f64, shrink: f64) -> Vec<Point> {
        (0..n)
            .map(|i| {
                let t = i as f64 / n as f64;
                let (sin, cos) = (TAU * turns * t).sin_cos();
                let r = 1.0 - shrink * (TAU * t).sin();
                [r * cos, r * sin]
            })
            .collect()
    }

    #[test]
    fn circle_is_simple() {
        let points = circle(100, 1.0, 0.0);
        assert!(is_simple(&points));
        assert_eq!(covered_twice(&points), 0.0);
    }

    #[test]
    fn double_loop_covers_its_inner_loop_twice() {
        let points = circle(4000, 2.0, 0.5);
        assert!(!is_simple(&points));
        let shoelace: f64 = (0..points.len())
            .map(|i| {
                let (p, q) = (points[i], points[(i + 1) % points.len()]);
                0.5 * (p[0] * q[1] - p[1] * q[0])
            })
            .sum();
        // The area by winding is the covered area plus the area covered twice; the loops meet once,
        // and the outer one is the half of the curve with the larger radii.
        let outer: f64 = (points.len() / 2..points.len())
            .map(|i| {
                let (p, q) = (points[i], points[(i + 1) % points.len()]);
                0.5 * (p[0] * q[1] - p[1] * q[0])
            })
            .sum();
        let twice = covered_twice(&points);
        assert!(
            (twice - (shoelace - outer)).abs() < 5e-3 * twice,
            "{twice} {outer}"
        );
    }

    #[test]
    fn figure_eight_is_covered_from_behind() {
        let points = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(!is_simple(&points));
        assert!((covered_twice(&points) - 0.25).abs() < 1e-3);
    }

    #[test]
    fn spikes_are_meeting() {
        assert!(!is_simple(&[
            [0.0, 0.0],
            [2.0, 0.0],
            [3.0, 0.0],
            [2.0, 0.0],
            [1.0, 1.0]
        ]));
        assert!(!is_simple(&[
            [0.0, 0.0],
            [3.0, 0.0],
            [2.0, 0.0],
            [1.0, 1.0]
        ]));
        assert!(is_simple(&[[0.0, 0.0], [2.0, 0.0], [3.0, 0.0], [1.0, 1.0]]));
    }

    #[test]
    fn touching_is_meeting() {
        let points = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(!is_simple(&points));
    }
}
