//! What a chart costs: its boundary, its cut, the distortion of its conformal map, its overlap.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::disk::{Disk, Opened};
use super::factor::{Factor, Matrix};
use super::geometry::Geometry;
use super::marks::{Marks, union};
use crate::error::Result;
use crate::flatten::polygon::{covered_twice, is_simple, turn};
use crate::flatten::touch::only_touches;
use crate::parallel::Buffers;
use crate::random::mixed;

/// What a chart costs by itself, in roots of the area: a tenth of it of seam. Without it tiny charts
/// plug peaks.
const CHART: f64 = 0.1;
/// Area below which a chart is too small to be one, and what it costs then.
pub(super) const SMALLEST: f64 = 1e-3;
const TINY: f64 = 1.0;
/// What an overlap costs however small, as in the end a chart with one is split. Cheap enough not to
/// keep boundaries from moving through overlaps.
const REPAIR: f64 = 0.3;
/// Area that is covered twice, relative to squared log scale.
const OVERLAP: f64 = 0.25;
/// Height of a face, relative to the extent of its map, below which it may be turned over: 4 units in
/// the last place of a coordinate in single precision.
const THIN: f64 = 4.0 * f32::EPSILON as f64;
/// Faces of a chart up to which the factor of its stiffness is kept for what is asked next.
const KEPT: usize = 100_000;
/// Tables of known energies, so that threads rarely wait for each other.
const SHARDS: usize = 16;

/// Figures of a chart on the surface of unit area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Area of its faces.
    pub area: f64,
    /// Euler characteristic before the cut.
    pub euler_characteristic: i64,
    /// Length of the boundary but that of the surface.
    pub perimeter: f64,
    /// Length of the cut that opens it to a disk.
    pub cut: f64,
    /// Integral of the squared log scale of the conformal map that keeps lengths on the boundary.
    pub distortion: f64,
    /// Area that the boundary of the map covers more than once.
    pub overlap: f64,
    /// Whether the boundary of the map does not cross itself; it may touch itself.
    pub simple: bool,
    /// Faces that the map turns over, once they have been counted.
    pub flips: Option<usize>,
}

impl Terms {
    /// Whether its map is known to be a bijection.
    #[must_use]
    pub fn injective(&self) -> bool {
        self.simple && self.flips == Some(0)
    }
}

/// The weights of the energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Weight of the integral of the squared log scale.
    pub distortion: f64,
    /// Whether a chart that overlaps itself costs infinitely much.
    pub injective: bool,
    /// Whether one that has faces turned over does then, too.
    pub upright: bool,
}

impl Rule {
    /// The share of a chart in the energy; a seam counts half for the chart on either side.
    #[must_use]
    pub fn cost(&self, terms: &Terms) -> f64 {
        if self.injective && self.upright && terms.flips != Some(0) {
            return f64::INFINITY;
        }
        self.least_cost(terms)
    }

    /// Whether the cost is known without a look at the faces.
    fn is_certain(&self, terms: &Terms) -> bool {
        !(self.injective && self.upright && terms.simple) || terms.flips.is_some()
    }

    /// The cost if no face is turned over.
    fn least_cost(&self, terms: &Terms) -> f64 {
        if self.injective && !terms.simple {
            return f64::INFINITY;
        }
        let repair = if terms.simple { 0.0 } else { REPAIR };
        let tiny = if terms.area < SMALLEST { TINY } else { 0.0 };
        0.5 * terms.perimeter
            + terms.cut
            + CHART
            + repair
            + tiny
            + self.distortion * (terms.distortion + OVERLAP * terms.overlap)
    }
}

/// A connected set of faces and its figures.
#[derive(Debug)]
pub(super) struct Chart {
    /// Sorted.
    pub faces: Vec<u32>,
    pub hash: u128,
    pub terms: Terms,
    /// What is left of the computation of the terms, until the sensitivity has been asked for.
    solution: Mutex<Option<Solution>>,
    sensitivity: OnceLock<Vec<f64>>,
}

/// A chart as a disk, the factor of its stiffness, its log scale.
struct Solution {
    disk: Disk,
    factor: Factor,
    log_scale: Vec<f64>,
}

impl std::fmt::Debug for Solution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Solution")
            .field("log_scale", &self.log_scale)
            .finish_non_exhaustive()
    }
}

/// The surface, and the energies of all charts that have been asked for.
pub(super) struct Energies {
    pub geometry: Geometry,
    marks: Buffers<Marks>,
    known: [Mutex<HashMap<u128, Terms>>; SHARDS],
}

impl Energies {
    pub fn new(geometry: Geometry) -> Self {
        Self {
            geometry,
            marks: Buffers::default(),
            known: Default::default(),
        }
    }

    /// Lends marks, which do not hold the thread pool up.
    pub fn with_marks<T>(&self, work: impl FnOnce(&mut Marks) -> T) -> T {
        let mut marks = self.marks.take().unwrap_or_default();
        let value = work(&mut marks);
        self.marks.give_back(marks);
        value
    }

    /// A number for a set of faces, no two alike; that of a union is the exclusive or.
    pub fn hash(faces: &[u32]) -> u128 {
        faces.iter().fold(0, |hash, &f| hash ^ face_hash(f))
    }

    /// The chart of sorted, connected faces.
    pub fn chart(&self, faces: Vec<u32>, rule: &Rule) -> Arc<Chart> {
        let hash = Self::hash(&faces);
        let (terms, solution) = self
            .known(hash)
            .filter(|terms| rule.is_certain(terms))
            .map_or_else(|| self.evaluate(hash, &faces, rule), |terms| (terms, None));
        Arc::new(Chart {
            hash,
            terms,
            solution: Mutex::new(solution.filter(|_| faces.len() <= KEPT)),
            faces,
            sensitivity: OnceLock::new(),
        })
    }

    /// The figures of a set of faces that has been evaluated before.
    fn known(&self, hash: u128) -> Option<Terms> {
        lock(&self.known[hash as usize % SHARDS])
            .get(&hash)
            .copied()
    }

    /// Notes that a chart covers points twice, whatever its map here says.
    pub fn condemn(&self, chart: &Chart) {
        let terms = Terms {
            simple: false,
            ..chart.terms
        };
        lock(&self.known[chart.hash as usize % SHARDS]).insert(chart.hash, terms);
    }

    /// What the union of two charts costs; [`None`] where that is not below `limit`.
    pub fn cost_of_union(&self, a: &Chart, b: &Chart, rule: &Rule, limit: f64) -> Option<f64> {
        if let Some(terms) = self.known(a.hash ^ b.hash)
            && rule.least_cost(&terms) >= limit
        {
            return None;
        }
        let cost = self.cost_of_any_union(a, b, rule);
        (cost < limit).then_some(cost)
    }

    /// What the union of two charts costs.
    pub fn cost_of_any_union(&self, a: &Chart, b: &Chart, rule: &Rule) -> f64 {
        let hash = a.hash ^ b.hash;
        match self.known(hash) {
            Some(terms) if rule.is_certain(&terms) => rule.cost(&terms),
            _ => rule.cost(&self.evaluate(hash, &union(&a.faces, &b.faces), rule).0),
        }
    }

    fn evaluate(&self, hash: u128, faces: &[u32], rule: &Rule) -> (Terms, Option<Solution>) {
        let found = self.with_marks(|marks| {
            terms(&self.geometry, faces, rule.injective && rule.upright, marks)
        });
        lock(&self.known[hash as usize % SHARDS]).insert(hash, found.0);
        found
    }

    /// Change of the distortion of a chart for each area that it gains at its boundary: grad s .
    /// grad p on each face, where the log scale s and its adjoint p vanish on the boundary and
    /// -lap p = 2 s.
    pub fn sensitivity<'a>(&self, chart: &'a Chart) -> &'a [f64] {
        chart.sensitivity.get_or_init(|| {
            let solution = lock(&chart.solution).take();
            let values =
                self.with_marks(|marks| sensitivity(&self.geometry, &chart.faces, solution, marks));
            values.unwrap_or_else(|| vec![0.0; chart.faces.len()])
        })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn face_hash(face: u32) -> u128 {
    let low = mixed(u64::from(face) << 1);
    let high = mixed((u64::from(face) << 1) | 1);
    u128::from(high) << 64 | u128::from(low)
}

fn terms(
    geometry: &Geometry,
    faces: &[u32],
    count_flips: bool,
    marks: &mut Marks,
) -> (Terms, Option<Solution>) {
    let area = geometry.area_of(faces);
    let (shape, disk) = match Disk::open(geometry, faces, marks) {
        Opened::Disk(disk) => (disk.shape, Some(disk)),
        Opened::Planar(shape) => {
            let terms = Terms {
                area,
                euler_characteristic: shape.euler_characteristic,
                perimeter: shape.perimeter,
                cut: 0.0,
                distortion: 0.0,
                overlap: 0.0,
                simple: true,
                flips: Some(0),
            };
            return (terms, None);
        }
        Opened::Closed(shape) => (shape, None),
    };
    let mut terms = Terms {
        area,
        euler_characteristic: shape.euler_characteristic,
        perimeter: shape.perimeter,
        cut: shape.cut,
        distortion: f64::INFINITY,
        overlap: 0.0,
        simple: false,
        flips: None,
    };
    let solution = disk.and_then(|disk| Solution::new(geometry, disk, marks));
    let Some(Solution {
        disk,
        mut factor,
        log_scale,
    }) = solution
    else {
        return (terms, None);
    };
    let boundary = flat_boundary(geometry, &disk, &log_scale, marks);
    terms.distortion = disk
        .inner
        .iter()
        .zip(&log_scale)
        .map(|(&v, s)| geometry.vertices.masses[v as usize] * s * s)
        .sum();
    terms.simple = is_simple(&boundary) || only_touches(&boundary);
    if !terms.simple {
        terms.overlap = covered_twice(&boundary);
    } else if count_flips {
        terms.flips = flips(geometry, faces, &disk, &mut factor, &boundary, marks).ok();
    }
    if !terms.distortion.is_finite() {
        terms.distortion = f64::INFINITY;
        terms.simple = false;
    }
    let solution = Solution {
        disk,
        factor,
        log_scale,
    };
    (terms, Some(solution))
}

impl Solution {
    /// None where the numbers do not allow one.
    fn new(geometry: &Geometry, disk: Disk, marks: &Marks) -> Option<Self> {
        let mut factor = factor(geometry, &disk, marks).ok()?;
        let log_scale = log_scale(geometry, &disk, &mut factor).ok()?;
        Some(Self {
            disk,
            factor,
            log_scale,
        })
    }
}

/// The factor of the stiffness matrix of the inner vertices.
fn factor(geometry: &Geometry, disk: &Disk, marks: &Marks) -> Result<Factor> {
    let vertices = &geometry.vertices;
    let n = disk.inner.len();
    let mut matrix = Matrix {
        diagonal: Vec::with_capacity(n),
        starts: Vec::with_capacity(n + 1),
        columns: Vec::with_capacity(3 * n),
        values: Vec::with_capacity(3 * n),
    };
    matrix.starts.push(0);
    for &v in &disk.inner {
        let v = v as usize;
        matrix.diagonal.push(vertices.diagonal[v]);
        for entry in vertices.row_starts[v]..vertices.row_starts[v + 1] {
            if let Some(i) = marks.vertex(vertices.columns[entry] as usize) {
                matrix.columns.push(i as u32);
                matrix.values.push(vertices.values[entry]);
            }
        }
        matrix.starts.push(matrix.columns.len());
    }
    Factor::new(&matrix)
}

/// Minus the log scale u of the flat metric e^{2 u} g with u = 0 on the boundary, at the inner
/// vertices.
fn log_scale(geometry: &Geometry, disk: &Disk, factor: &mut Factor) -> Result<Vec<f64>> {
    let mut s: Vec<f64> = disk
        .inner
        .iter()
        .map(|&v| geometry.vertices.defects[v as usize])
        .collect();
    factor.solve(&mut s)?;
    Ok(s)
}

/// The boundary in the plane: turned as the scale prescribes, its edges kept in length but for the
/// least change that closes the curve (Sawhney and Crane 2017).
fn flat_boundary(
    geometry: &Geometry,
    disk: &Disk,
    log_scale: &[f64],
    marks: &Marks,
) -> Vec<[f64; 2]> {
    let mut angle = 0.0_f64;
    let mut tangents = Vec::with_capacity(disk.boundary.len());
    for fan in disk.fan_starts.windows(2) {
        angle += std::f64::consts::PI;
        for &h in &disk.fans[fan[0]..fan[1]] {
            let h = h as usize;
            angle -= geometry.angles[h];
            if let Some(w) = marks.vertex(head(geometry, h)) {
                angle -= geometry.stiffness[h] * log_scale[w];
            }
        }
        tangents.push([angle.cos(), angle.sin()]);
    }
    let lengths = || disk.boundary.iter().map(|&h| geometry.lengths[h as usize]);
    let mut gap = [0.0; 2];
    let mut normal = [[0.0; 2]; 2];
    for (tangent, length) in tangents.iter().zip(lengths()) {
        for r in 0..2 {
            gap[r] += length * tangent[r];
            for c in 0..2 {
                normal[r][c] += length * tangent[r] * tangent[c];
            }
        }
    }
    let determinant = normal[0][0] * normal[1][1] - normal[0][1] * normal[1][0];
    let correction = [
        (normal[1][1] * gap[0] - normal[0][1] * gap[1]) / determinant,
        (normal[0][0] * gap[1] - normal[1][0] * gap[0]) / determinant,
    ];
    let mut point = [0.0; 2];
    let mut curve = Vec::with_capacity(tangents.len());
    for (tangent, length) in tangents.iter().zip(lengths()) {
        curve.push(point);
        let change = 1.0 - correction[0] * tangent[0] - correction[1] * tangent[1];
        for axis in 0..2 {
            point[axis] += change * length * tangent[axis];
        }
    }
    curve
}

/// Faces that the harmonic extension of the boundary turns over, but for those that single precision
/// cannot show.
fn flips(
    geometry: &Geometry,
    faces: &[u32],
    disk: &Disk,
    factor: &mut Factor,
    boundary: &[[f64; 2]],
    marks: &Marks,
) -> Result<usize> {
    let n = disk.inner.len();
    let mut columns = vec![0.0; 2 * n];
    let mut corners = vec![[0.0; 2]; 3 * faces.len()];
    for (fan, point) in disk.fan_starts.windows(2).zip(boundary) {
        for &h in &disk.fans[fan[0]..fan[1]] {
            let h = h as usize;
            if let Some(i) = marks.face(h / 3) {
                corners[3 * i + h % 3] = *point;
            }
            if let Some(w) = marks.vertex(head(geometry, h)) {
                for axis in 0..2 {
                    columns[axis * n + w] -= geometry.stiffness[h] * point[axis];
                }
            }
        }
    }
    factor.solve(&mut columns)?;
    let extent = (0..2)
        .map(|axis| {
            let (low, high) = boundary
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
                    (low.min(p[axis]), high.max(p[axis]))
                });
            high - low
        })
        .fold(0.0, f64::max);
    let mut count = 0;
    for (i, &f) in faces.iter().enumerate() {
        for k in 0..3 {
            if let Some(w) = marks.vertex(geometry.origins[3 * f as usize + k] as usize) {
                corners[3 * i + k] = [columns[w], columns[n + w]];
            }
        }
        let [a, b, c] = [0, 1, 2].map(|k| corners[3 * i + k]);
        // Not a number is no map either.
        let area = turn(a, b, c);
        let thin = || {
            let length = |p: [f64; 2], q: [f64; 2]| (q[0] - p[0]).hypot(q[1] - p[1]);
            let longest = length(a, b).max(length(b, c)).max(length(c, a));
            area.abs() < THIN * extent * longest
        };
        count += usize::from(!(area > 0.0 || thin()));
    }
    Ok(count)
}

fn sensitivity(
    geometry: &Geometry,
    faces: &[u32],
    solution: Option<Solution>,
    marks: &mut Marks,
) -> Option<Vec<f64>> {
    let solution = if let Some(solution) = solution {
        solution.disk.mark(geometry, faces, marks);
        solution
    } else {
        let Opened::Disk(disk) = Disk::open(geometry, faces, marks) else {
            return None;
        };
        Solution::new(geometry, disk, marks)?
    };
    let Solution {
        disk,
        mut factor,
        log_scale: s,
    } = solution;
    let mut p: Vec<f64> = disk
        .inner
        .iter()
        .zip(&s)
        .map(|(&v, s)| 2.0 * geometry.vertices.masses[v as usize] * s)
        .collect();
    factor.solve(&mut p).ok()?;
    let at = |values: &[f64], h: usize| {
        marks
            .vertex(geometry.origins[h] as usize)
            .map_or(0.0, |v| values[v])
    };
    Some(
        faces
            .iter()
            .map(|&f| {
                let f = f as usize;
                let [s, p] = [&s, &p].map(|values| [0, 1, 2].map(|k| at(values, 3 * f + k)));
                let sum: f64 = (0..3)
                    .map(|k| {
                        let next = (k + 1) % 3;
                        geometry.half_cotangents[3 * f + k] * (s[next] - s[k]) * (p[next] - p[k])
                    })
                    .sum();
                sum / geometry.areas[f]
            })
            .collect(),
    )
}

/// The vertex that a half-edge ends at.
fn head(geometry: &Geometry, h: usize) -> usize {
    geometry.origins[super::geometry::next(h)] as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::Surface;
    use crate::testing::grid;

    /// A block of cells in the middle of a grid of 80 x 80, `half` cells in each direction.
    fn block(half: usize) -> Vec<u32> {
        (0..2 * 80 * 80)
            .filter(|f| {
                let (i, j) = (f / 2 % 80, f / 160);
                (40 - half..40 + half).contains(&i) && (40 - half..40 + half).contains(&j)
            })
            .map(|f| f as u32)
            .collect()
    }

    #[test]
    fn sensitivity_is_the_derivative_by_moves() {
        let dome = grid(80, 80, |x, y| {
            0.7 - (x - 0.4).powi(2) - 0.5 * (y - 0.5).powi(2) - 0.3 * x * y
        });
        let energies = Energies::new(Geometry::new(&Surface::new(dome)).unwrap());
        let rule = Rule {
            distortion: 600.0,
            injective: true,
            upright: true,
        };
        let charts = [24, 25].map(|half| energies.chart(block(half), &rule));
        assert!(charts.iter().all(|chart| chart.terms.injective()));
        let change = charts[1].terms.distortion - charts[0].terms.distortion;
        // At the boundary before and after, over the area that is gained.
        let gained: f64 = charts[1].terms.area - charts[0].terms.area;
        let mean = |k: usize, inside: usize| {
            let inner = block(inside);
            let values = energies.sensitivity(&charts[k]);
            let ring = charts[k].faces.iter().zip(values);
            let (sum, area) = ring.filter(|(f, _)| inner.binary_search(f).is_err()).fold(
                (0.0, 0.0),
                |(sum, area), (&f, value)| {
                    let a = energies.geometry.areas[f as usize];
                    (sum + a * value, area + a)
                },
            );
            sum / area
        };
        let expected = 0.5 * (mean(0, 23) + mean(1, 24)) * gained;
        assert!(change > 0.0);
        assert!((expected / change - 1.0).abs() < 0.1, "{expected} {change}");
    }

    #[test]
    fn hash_of_a_union() {
        let [a, b] = [Energies::hash(&[1, 5]), Energies::hash(&[2, 7])];
        assert_eq!(a ^ b, Energies::hash(&[1, 2, 5, 7]));
        assert_ne!(a, b);
    }
}
