//! Whether a map of some faces to the plane is a bijection.

use std::collections::HashMap;

use super::polygon::{Point, are_apart, turn};
use super::touch::only_touches;

/// What keeps a map from being a bijection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Faults {
    /// Faces that are turned over or have no area, without those that are thin.
    pub flips: usize,
    /// Whether the boundary of the map crosses itself. It may pass a vertex twice, and a single loop
    /// may touch itself up to rounding, as the banks of a slit through a flat part do.
    pub crosses: bool,
    /// Faces too thin to be judged.
    pub thin: usize,
}

impl Faults {
    /// Whether the map is a bijection, thin faces aside.
    #[must_use]
    pub fn none(&self) -> bool {
        self.flips == 0 && !self.crosses
    }
}

/// Looks at a map of connected faces, a disk with or without holes. Exact for the given numbers.
///
/// A map that turns no face over covers each point as often as its boundary winds about it: once or
/// not at all where the boundary does not cross itself.
///
/// Faces of less height than `thin` may be turned over. At the boundary they are left out.
///
/// # Examples
/// ```
/// use phaseatlas_core::flatten::faults;
///
/// let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.9, 0.1]];
/// assert!(faults(&[[0, 1, 2]], &uv, 0.0).none());
/// assert_eq!(faults(&[[0, 1, 2], [0, 2, 3]], &uv, 0.0).flips, 1);
/// ```
#[must_use]
pub fn faults(faces: &[[u32; 3]], uv: &[Point], thin: f64) -> Faults {
    let at = |v: u32| uv[v as usize];
    let mut flips = 0;
    let mut exempt = vec![false; faces.len()];
    for (exempt, face) in exempt.iter_mut().zip(faces) {
        let corners = face.map(at);
        let area = turn(corners[0], corners[1], corners[2]);
        let longest = (0..3)
            .map(|k| length(corners[k], corners[(k + 1) % 3]))
            .fold(0.0, f64::max);
        *exempt = area.abs() <= thin * longest && thin > 0.0;
        // Not a number is no map either.
        let upright = area > 0.0;
        flips += usize::from(!upright && !*exempt);
    }
    let thin = exempt.iter().filter(|exempt| **exempt).count();
    let kept = without_thin_rim(faces, &exempt);
    Faults {
        flips,
        crosses: crosses(&kept, uv),
        thin,
    }
}

fn length(p: Point, q: Point) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

type Sides = HashMap<[u32; 2], usize>;

/// The face on the left of each side.
fn sides_of(faces: &[[u32; 3]]) -> Sides {
    (0..3 * faces.len())
        .map(|h| ([faces[h / 3][h % 3], faces[h / 3][(h + 1) % 3]], h))
        .collect()
}

/// The faces without those exempt ones that lie at the boundary, or come to lie there.
fn without_thin_rim(faces: &[[u32; 3]], exempt: &[bool]) -> Vec<[u32; 3]> {
    if !exempt.contains(&true) {
        return faces.to_vec();
    }
    let sides = sides_of(faces);
    let mut gone = vec![false; faces.len()];
    let across = |f: usize, k: usize| {
        let side = [faces[f][(k + 1) % 3], faces[f][k]];
        sides.get(&side).map(|h| h / 3)
    };
    let mut open: Vec<usize> = (0..faces.len())
        .filter(|&f| exempt[f] && (0..3).any(|k| across(f, k).is_none()))
        .collect();
    while let Some(f) = open.pop() {
        if std::mem::replace(&mut gone[f], true) {
            continue;
        }
        open.extend(
            (0..3)
                .filter_map(|k| across(f, k))
                .filter(|&g| exempt[g] && !gone[g]),
        );
    }
    (0..faces.len())
        .filter(|&f| !gone[f])
        .map(|f| faces[f])
        .collect()
}

fn crosses(faces: &[[u32; 3]], uv: &[Point]) -> bool {
    let open = open_sides(faces);
    if !are_apart(uv, &open) {
        return !single_loop(&open, uv).is_some_and(|points| only_touches(&points));
    }
    if open.windows(2).all(|sides| sides[0][0] != sides[1][0]) {
        return false;
    }
    // The fans of faces around a vertex where the boundary passes more than once.
    let sides = sides_of(faces);
    open.chunk_by(|p, q| p[0] == q[0])
        .filter(|group| group.len() > 1)
        .any(|group| {
            let fans: Vec<[Point; 2]> = group
                .iter()
                .map(|&side| [side[1], end_of_fan(faces, &sides, side)].map(|v| uv[v as usize]))
                .collect();
            let centre = uv[group[0][0] as usize];
            (0..fans.len())
                .any(|i| (0..fans.len()).any(|j| i != j && is_between(centre, fans[i], fans[j][0])))
        })
}

/// The sides that have a face on the left alone, sorted.
fn open_sides(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    // Both directions of a side next to each other.
    let mut sides: Vec<([u32; 2], bool)> = faces
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| ([a.min(b), a.max(b)], a > b))
        .collect();
    sides.sort_unstable();
    sides.dedup();
    let mut open: Vec<[u32; 2]> = sides
        .chunk_by(|p, q| p.0 == q.0)
        .filter(|group| group.len() == 1)
        .map(|group| match group[0] {
            ([a, b], false) => [a, b],
            ([a, b], true) => [b, a],
        })
        .collect();
    open.sort_unstable();
    open
}

/// The points of the sides in a row, where they make one loop that passes every vertex once.
fn single_loop(open: &[[u32; 2]], uv: &[Point]) -> Option<Vec<Point>> {
    let after: HashMap<u32, u32> = open.iter().map(|&[a, b]| (a, b)).collect();
    let start = open.first()?[0];
    let mut points = vec![uv[start as usize]];
    let mut vertex = *after.get(&start)?;
    while vertex != start && points.len() < open.len() {
        points.push(uv[vertex as usize]);
        vertex = *after.get(&vertex)?;
    }
    (vertex == start && points.len() == open.len()).then_some(points)
}

/// The last vertex of the fan of faces that begins at the open side v to b, turning left about v.
fn end_of_fan(faces: &[[u32; 3]], sides: &Sides, [v, b]: [u32; 2]) -> u32 {
    let mut end = b;
    while let Some(h) = sides.get(&[v, end]) {
        end = faces[h / 3][(h + 2) % 3];
        if end == b {
            break;
        }
    }
    end
}

/// Whether p lies strictly between the first and the last direction of a fan, turning left.
fn is_between(centre: Point, [first, last]: [Point; 2], p: Point) -> bool {
    if turn(centre, first, last) > 0.0 {
        turn(centre, first, p) > 0.0 && turn(centre, p, last) > 0.0
    } else {
        !(turn(centre, last, p) >= 0.0 && turn(centre, p, first) >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [Point; 5] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]];

    #[test]
    fn fan_is_a_bijection_until_its_centre_leaves() {
        let faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let mut uv = SQUARE;
        assert!(faults(&faces, &uv, 0.0).none());
        uv[4] = [1.5, 0.5];
        let found = faults(&faces, &uv, 0.0);
        assert_eq!((found.flips, found.crosses), (1, false));
    }

    #[test]
    fn spiral_covers_twice_without_a_flip() {
        // A strip that turns about the origin by more than one turn at the same radii.
        let strip = |turns: f64, drift: f64| {
            let n = 60;
            let uv: Vec<Point> = (0..2 * n)
                .map(|i| {
                    let t = f64::from(i / 2) / f64::from(n - 1);
                    let r = 1.0 + f64::from(i % 2) + drift * t;
                    let (sin, cos) = (std::f64::consts::TAU * turns * t).sin_cos();
                    [r * cos, r * sin]
                })
                .collect();
            let faces: Vec<[u32; 3]> = (0..n as u32 - 1)
                .flat_map(|i| {
                    let a = 2 * i;
                    [[a, a + 1, a + 3], [a, a + 3, a + 2]]
                })
                .collect();
            faults(&faces, &uv, 0.0)
        };
        assert!(strip(0.9, 0.0).none());
        assert!(strip(1.2, 1.5).none());
        assert_eq!(strip(1.2, 0.0).flips, 0);
        assert!(strip(1.2, 0.0).crosses);
    }

    #[test]
    fn fans_at_one_vertex_may_touch_but_not_overlap() {
        let faces = [[0, 1, 2], [0, 3, 4]];
        let fan = |p: Point, q: Point| {
            let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], p, q];
            faults(&faces, &uv, 0.0).none()
        };
        assert!(fan([-1.0, 0.0], [-1.0, -1.0]));
        assert!(!fan([0.2, 0.1], [0.1, 0.2]));
        assert!(!fan([3.0, 0.0], [3.0, 3.0]));
    }

    #[test]
    fn thin_faces_are_exempt() {
        let faces = [[0, 1, 2], [0, 2, 3], [1, 0, 4]];
        let mut uv = SQUARE;
        uv[4] = [0.5, 1e-9];
        let found = faults(&faces, &uv, 1e-8);
        assert_eq!((found.none(), found.thin), (true, 1));
        assert!(!faults(&faces, &uv, 1e-10).none());
    }
}
