//! Moves of the boundary between two charts: minimum cuts in a band around it.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::charts::{Charts, Seams, pieces, seams};
use super::energy::{Chart, Energies, Rule};
use super::flow::{Network, Side};
use super::geometry::{Geometry, next};
use super::marks::Marks;
use super::marks::union;

/// Half the width of the first and narrowest band, and of the widest, in mean edge lengths. Where all
/// bands began with the widest, 90 % of 300 moves that were accepted were no wider than twice the
/// narrowest: the derivative does not carry farther.
const NARROWEST: f64 = 0.75;
const WIDEST: f64 = 6.0;
/// Growth of the next band where a cut has been accepted.
const WIDENING: f64 = 2.0;
/// Factors of the derivative of the distortion, which is too low for a chart that grows. A third one
/// of 9 brought 3 % of the gain.
const FACTORS: [f64; 2] = [1.0, 3.0];
/// Averagings of the derivative along the boundary.
const SMOOTHINGS: usize = 4;
/// What a split costs about, in roots of the area.
const SPLIT: f64 = 0.5;
/// Least gain of a move, in roots of the area.
const GAIN: f64 = 1e-6;
/// Gain that a cut is to promise before its exact energy is asked for.
const PROMISE: f64 = 1e-4;

/// Gain of a sweep, relative to the energy, at which the boundaries rest.
const REST: f64 = 1e-4;
/// Gains of the last sweep that the next ones together may bring. Those of 15 perturbations that
/// paid brought at most 2.95.
const SIGHT: f64 = 3.0;

/// What a sequence of sweeps remembers.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    /// Pairs of charts, by their hashes, whose boundary no cut improves.
    settled: HashSet<(u128, u128)>,
    /// Band of the first attempt at a pair of labels, in mean edge lengths.
    first: f64,
    /// Band of the next attempt, and the factor that is tried first.
    next: HashMap<(u32, u32), Attempt>,
    /// Cuts of a boundary of which the exact energy is asked for, at most.
    pub tries: usize,
    /// Charts whose boundaries may move; all where there is none.
    pub active: Option<BTreeSet<u32>>,
}

impl Memory {
    pub fn new(first: f64) -> Self {
        Self {
            settled: HashSet::new(),
            first: first.max(NARROWEST),
            next: HashMap::new(),
            tries: usize::MAX,
            active: None,
        }
    }

    /// Forgets all but the first band and the number of tries.
    pub fn clear(&mut self) {
        *self = Self {
            tries: self.tries,
            ..Self::new(self.first)
        };
    }
}

#[derive(Debug, Clone, Copy)]
struct Attempt {
    /// Half the width of the band, in mean edge lengths.
    radius: f64,
    /// Place in [`FACTORS`].
    factor: usize,
}

/// Two charts that take the place of two others.
struct Move {
    charts: [Arc<Chart>; 2],
    gain: f64,
    attempt: Attempt,
}

/// Moves each boundary once, the longest first; after the first sweep only those of charts that have
/// changed in the last. Returns the gain.
pub(super) fn sweep(
    energies: &Energies,
    charts: &mut Charts,
    rule: &Rule,
    memory: &mut Memory,
) -> f64 {
    let active = memory.active.take();
    let mut pairs = ordered(&charts.seams(&energies.geometry), |(a, b)| {
        active
            .as_ref()
            .is_none_or(|set| set.contains(a) || set.contains(b))
    });
    let mut gain = 0.0;
    let mut changed = BTreeSet::new();
    while !pairs.is_empty() {
        let (now, later) = apart(pairs);
        pairs = later;
        let moves: Vec<Option<Move>> = now
            .par_iter()
            .map(|pair| {
                if memory.settled.contains(&key(charts, *pair)) {
                    return None;
                }
                let first = Attempt {
                    radius: memory.first,
                    factor: 0,
                };
                let attempt = memory.next.get(pair).copied().unwrap_or(first);
                improve(energies, charts, *pair, rule, attempt, memory.tries)
            })
            .collect();
        for (pair, found) in now.into_iter().zip(moves) {
            if let Some(Move {
                charts: [a, b],
                gain: by,
                attempt,
            }) = found
            {
                gain += by;
                charts.replace(pair.0, a);
                charts.replace(pair.1, b);
                changed.extend([pair.0, pair.1]);
                let radius = (WIDENING * attempt.radius).min(WIDEST);
                memory.next.insert(pair, Attempt { radius, ..attempt });
            } else {
                memory.settled.insert(key(charts, pair));
                let narrow = Attempt {
                    radius: NARROWEST,
                    factor: 0,
                };
                memory.next.insert(pair, narrow);
            }
        }
    }
    memory.active = Some(changed);
    gain
}

/// Charts whose labels come from another surface where their boundaries are at rest, with boundaries
/// drawn straight. Nothing is solved: `sensitivity` is that of each face there, the cuts do what they
/// promise. Labels and what is returned are those of connected pieces.
pub(super) fn carried(
    energies: &Energies,
    mut labels: Vec<u32>,
    mut charts: Vec<Vec<u32>>,
    sensitivity: &[f64],
    distortion: f64,
    radius: f64,
) -> Vec<u32> {
    let geometry = &energies.geometry;
    let mut pairs = ordered(&seams(geometry, &labels), |_| true);
    while !pairs.is_empty() {
        let (now, later) = apart(pairs);
        pairs = later;
        let found: Vec<Option<[Vec<u32>; 2]>> = now
            .par_iter()
            .map(|&(a, b)| {
                let faces = [a, b].map(|label| &charts[label as usize][..]);
                let of = |faces: &[u32]| -> Vec<f64> {
                    faces.iter().map(|&f| sensitivity[f as usize]).collect()
                };
                let [first, second] = faces.map(of);
                energies.with_marks(|marks| {
                    let slopes = [&first[..], &second[..]];
                    let interface =
                        Interface::new(geometry, &labels, [a, b], faces, slopes, marks)?;
                    let band = interface.band(geometry, &labels, [a, b], radius, marks);
                    let (promise, sides) = band.cut(&labels, b, distortion);
                    if promise < PROMISE {
                        return None;
                    }
                    separate(geometry, faces, &band.faces, &sides, marks)
                })
            })
            .collect();
        for ((a, b), parts) in now.into_iter().zip(found) {
            for (label, faces) in [a, b].into_iter().zip(parts.into_iter().flatten()) {
                for &f in &faces {
                    labels[f as usize] = label;
                }
                charts[label as usize] = faces;
            }
        }
    }
    labels
}

/// Pairs of charts.
type Pairs = Vec<(u32, u32)>;

/// The first pairs that have no chart in common, whose moves do not see each other, and the others.
fn apart(pairs: Pairs) -> (Pairs, Pairs) {
    let mut taken = BTreeSet::new();
    pairs.into_iter().partition(|&(a, b)| {
        let free = !taken.contains(&a) && !taken.contains(&b);
        taken.insert(a);
        taken.insert(b);
        free
    })
}

/// Whether a gain is too little, relative to the energy, to sweep on.
pub(super) fn at_rest(gain: f64, energy: f64) -> bool {
    gain < REST * energy
}

/// Sweeps from the `active` charts on until the boundaries rest, or `limit` times, or until an
/// energy below `goal` is out of sight.
pub(super) fn relax_towards(
    energies: &Energies,
    charts: &mut Charts,
    rule: &Rule,
    active: BTreeSet<u32>,
    limit: usize,
    goal: f64,
) {
    let mut memory = Memory {
        active: Some(active),
        ..Memory::new(NARROWEST)
    };
    for _ in 0..limit {
        let gain = sweep(energies, charts, rule, &mut memory);
        let energy = charts.energy(rule);
        if at_rest(gain, energy) || energy - goal > SIGHT * gain {
            break;
        }
    }
}

fn key(charts: &Charts, (a, b): (u32, u32)) -> (u128, u128) {
    (
        charts.charts[a as usize].hash,
        charts.charts[b as usize].hash,
    )
}

fn ordered(seams: &Seams, keep: impl Fn(&(u32, u32)) -> bool) -> Vec<(u32, u32)> {
    let mut pairs: Vec<(&(u32, u32), &f64)> = seams.iter().filter(|(pair, _)| keep(pair)).collect();
    pairs.sort_by(|x, y| y.1.total_cmp(x.1).then(x.0.cmp(y.0)));
    pairs.into_iter().map(|(pair, _)| *pair).collect()
}

fn improve(
    energies: &Energies,
    charts: &Charts,
    (a, b): (u32, u32),
    rule: &Rule,
    first: Attempt,
    tries: usize,
) -> Option<Move> {
    let pair = [a, b].map(|label| &charts.charts[label as usize]);
    let soft = Rule {
        injective: false,
        ..*rule
    };
    let total = |rule: &Rule| {
        pair.iter()
            .map(|chart| rule.cost(&chart.terms))
            .sum::<f64>()
    };
    // A chart that may not stay may cost more, but not more than to split it.
    let before = match total(rule) {
        cost if cost.is_finite() => cost,
        _ => total(&soft) + SPLIT,
    };
    let faces = pair.map(|chart| &chart.faces[..]);
    // The sensitivities need marks of their own.
    let sensitivities = pair.map(|chart| energies.sensitivity(chart));
    let interface = energies.with_marks(|marks| {
        Interface::new(
            &energies.geometry,
            &charts.labels,
            [a, b],
            faces,
            sensitivities,
            marks,
        )
    })?;
    let mut tried = HashSet::from([pair[0].hash]);
    let mut radius = first.radius;
    while radius >= NARROWEST {
        let band = energies.with_marks(|marks| {
            interface.band(&energies.geometry, &charts.labels, [a, b], radius, marks)
        });
        for turn in 0..FACTORS.len() {
            let factor = (first.factor + turn) % FACTORS.len();
            let (promise, sides) = band.cut(&charts.labels, b, FACTORS[factor] * rule.distortion);
            if promise < PROMISE {
                continue;
            }
            let parts = energies.with_marks(|marks| {
                separate(&energies.geometry, faces, &band.faces, &sides, marks)
            });
            let Some([first, second]) = parts else {
                continue;
            };
            if !tried.insert(Energies::hash(&first)) {
                continue;
            }
            // The charts as they are count as one.
            if tried.len() - 1 > tries {
                return None;
            }
            let found = [energies.chart(first, rule), energies.chart(second, rule)];
            let after = rule.cost(&found[0].terms) + rule.cost(&found[1].terms);
            if after < before - GAIN {
                return Some(Move {
                    charts: found,
                    gain: before - after,
                    attempt: Attempt { radius, factor },
                });
            }
        }
        radius *= 0.5;
    }
    None
}

/// The vertices on the boundary between two charts.
struct Interface {
    /// Surface vertex and the growth of the distortion where an area there goes to the second chart.
    vertices: Vec<u32>,
    slopes: Vec<f64>,
    /// Faces at these vertices, each with the nearest of them.
    seeds: Vec<(u32, u32)>,
}

/// Faces near a boundary, to be given to one side or the other.
struct Band {
    faces: Vec<u32>,
    /// Growth of the distortion where a face goes to the second chart.
    changes: Vec<f64>,
    /// What the lengths of the edges between the faces and around them cost.
    network: Network,
    /// What they cost now.
    length: f64,
}

impl Interface {
    /// The interface of two charts, whose sensitivities stand in the order of their faces.
    fn new(
        geometry: &Geometry,
        labels: &[u32],
        [a, b]: [u32; 2],
        charts: [&[u32]; 2],
        sensitivities: [&[f64]; 2],
        marks: &mut Marks,
    ) -> Option<Self> {
        let mut edges = Vec::new();
        for &f in charts[0].iter().filter(|&&f| labels[f as usize] == a) {
            for (h, g) in geometry.around(f as usize) {
                if labels[g] == b {
                    edges.push([geometry.origins[h], geometry.origins[next(h)], h as u32]);
                }
            }
        }
        let mut vertices: Vec<u32> = edges.iter().flat_map(|e| [e[0], e[1]]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        if vertices.is_empty() {
            return None;
        }
        marks.restart(geometry);
        for (i, &v) in (0..).zip(&vertices) {
            marks.set_vertex(v as usize, i);
        }

        let mut slopes = vec![0.0; vertices.len()];
        let mut seeds = Vec::new();
        for ((faces, sensitivity), sign) in charts.into_iter().zip(sensitivities).zip([-1.0, 1.0]) {
            let mut sums = vec![(0.0, 0.0); vertices.len()];
            for (&f, value) in faces.iter().zip(sensitivity) {
                let area = geometry.areas[f as usize];
                let mut nearest = (f64::INFINITY, 0);
                for k in 0..3 {
                    let v = geometry.origins[3 * f as usize + k];
                    if let Some(i) = marks.vertex(v as usize) {
                        sums[i].0 += area * value;
                        sums[i].1 += area;
                        let distance = distance(geometry, f as usize, v);
                        if distance < nearest.0 {
                            nearest = (distance, i as u32);
                        }
                    }
                }
                if nearest.0 < f64::INFINITY {
                    seeds.push((f, nearest.1));
                }
            }
            for (slope, (value, area)) in slopes.iter_mut().zip(sums) {
                *slope += sign * value / area;
            }
        }

        let edges: Vec<(usize, usize, f64)> = edges
            .iter()
            .filter_map(|&[v, w, h]| {
                let ends = marks.vertex(v as usize).zip(marks.vertex(w as usize))?;
                Some((ends.0, ends.1, geometry.lengths[h as usize]))
            })
            .collect();
        for _ in 0..SMOOTHINGS {
            let mut sums = vec![(0.0, 0.0); slopes.len()];
            for &(i, j, length) in &edges {
                sums[i].0 += length * slopes[j];
                sums[j].0 += length * slopes[i];
                sums[i].1 += length;
                sums[j].1 += length;
            }
            for (slope, (sum, length)) in slopes.iter_mut().zip(sums) {
                *slope = 0.5 * *slope + 0.5 * sum / length;
            }
        }
        Some(Self {
            vertices,
            slopes,
            seeds,
        })
    }

    /// Faces of both charts whose centroids are within `radius` mean edge lengths of the nearest
    /// vertex of the interface, found from face to face.
    fn band(
        &self,
        geometry: &Geometry,
        labels: &[u32],
        pair: [u32; 2],
        radius: f64,
        marks: &mut Marks,
    ) -> Band {
        let reach = radius * geometry.mean_edge_length;
        let mut found: Vec<(u32, u32)> = Vec::new();
        marks.restart(geometry);
        // Non-negative floats order as their bits.
        let mut heap: BinaryHeap<Reverse<(u64, u32, u32)>> = BinaryHeap::new();
        let push = |heap: &mut BinaryHeap<_>, f: u32, i: u32| {
            let distance = distance(geometry, f as usize, self.vertices[i as usize]);
            if distance <= reach {
                heap.push(Reverse((distance.to_bits(), f, i)));
            }
        };
        for &(f, i) in &self.seeds {
            push(&mut heap, f, i);
        }
        while let Some(Reverse((_, f, i))) = heap.pop() {
            if marks.face(f as usize).is_some() {
                continue;
            }
            marks.set_face(f as usize, found.len() as u32);
            found.push((f, i));
            for (_, g) in geometry.around(f as usize) {
                if pair.contains(&labels[g]) && marks.face(g).is_none() {
                    push(&mut heap, g as u32, i);
                }
            }
        }
        let mut network = Network::new(found.len());
        let mut costs = vec![[0.0; 2]; found.len()];
        let mut length = 0.0;
        for (i, &(f, _)) in found.iter().enumerate() {
            for (h, g) in geometry.around(f as usize) {
                let edge = geometry.costs[h];
                let place = marks.face(g);
                match place {
                    Some(j) if i < j => network.add_edge(i, j, edge),
                    None if labels[g] == pair[0] => costs[i][1] += edge,
                    None if labels[g] == pair[1] => costs[i][0] += edge,
                    _ => continue,
                }
                if labels[g] != labels[f as usize] {
                    length += edge;
                }
            }
        }
        for (i, [first, second]) in costs.into_iter().enumerate() {
            network.add_costs(i, first, second);
        }
        let changes = found
            .iter()
            .map(|&(f, i)| geometry.areas[f as usize] * self.slopes[i as usize])
            .collect();
        Band {
            faces: found.into_iter().map(|(f, _)| f).collect(),
            changes,
            network,
            length,
        }
    }
}

impl Band {
    /// Sides of the faces, the source being the first chart, for the given weight of distortion, and
    /// what is gained if length and slopes tell the truth.
    fn cut(&self, labels: &[u32], second: u32, weight: f64) -> (f64, Vec<Side>) {
        let mut network = self.network.clone();
        for (i, (&f, change)) in self.faces.iter().zip(&self.changes).enumerate() {
            // What the second chart gains or the first one gains back.
            if labels[f as usize] == second {
                network.add_costs(i, -weight * change, 0.0);
            } else {
                network.add_costs(i, 0.0, weight * change);
            }
        }
        let (cost, sides) = network.minimum_cut();
        (self.length - cost, sides)
    }
}

/// The two charts after the faces of a band have taken sides, but for pieces that are cut off: they
/// go to the other side. None where nothing is left of one.
fn separate(
    geometry: &Geometry,
    charts: [&[u32]; 2],
    band: &[u32],
    sides: &[Side],
    marks: &mut Marks,
) -> Option<[Vec<u32>; 2]> {
    marks.place(geometry, band);
    let mut faces: [Vec<u32>; 2] = Default::default();
    let mut taken: [Vec<u32>; 2] = Default::default();
    for (own, chart) in [Side::Source, Side::Sink].into_iter().zip(charts) {
        for &f in chart {
            let side = marks.face(f as usize).map_or(own, |i| sides[i]);
            let list = if side == own { &mut faces } else { &mut taken };
            list[usize::from(side == Side::Sink)].push(f);
        }
    }
    for k in 0..2 {
        faces[k] = union(&faces[k], &taken[k]);
    }
    for k in 0..2 {
        let mut parts = pieces(geometry, &faces[k], marks, |_| ());
        if parts.len() > 1 {
            let largest = (0..parts.len()).max_by(|&i, &j| {
                geometry
                    .area_of(&parts[i])
                    .total_cmp(&geometry.area_of(&parts[j]))
                    .then(j.cmp(&i))
            })?;
            faces[k] = parts.swap_remove(largest);
            for part in parts {
                faces[1 - k] = union(&faces[1 - k], &part);
            }
        }
    }
    let mut connected =
        |faces: &[u32]| !faces.is_empty() && pieces(geometry, faces, marks, |_| ()).len() == 1;
    (connected(&faces[0]) && connected(&faces[1])).then_some(faces)
}

fn distance(geometry: &Geometry, f: usize, v: u32) -> f64 {
    let d = super::geometry::subtract(geometry.centroids[f], geometry.positions[v as usize]);
    super::geometry::dot(d, d).sqrt()
}
