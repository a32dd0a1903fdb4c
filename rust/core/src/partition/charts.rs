//! A partition into charts, and the lists of faces that the moves work on.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::energy::{Chart, Energies, Rule};
use super::geometry::Geometry;
use super::marks::{Marks, union};
use crate::mesh::NONE;

/// Charts that share the faces of the surface among them.
#[derive(Debug, Clone)]
pub(super) struct Charts {
    /// Chart of each face.
    pub labels: Vec<u32>,
    pub charts: Vec<Arc<Chart>>,
}

/// Two charts and the length of their common boundary, by the smaller index first.
pub(super) type Seams = BTreeMap<(u32, u32), f64>;

impl Charts {
    /// The connected pieces of equal label.
    pub fn new(energies: &Energies, labels: &[u32], rule: &Rule) -> Self {
        let all: Vec<u32> = (0..labels.len() as u32).collect();
        let pieces =
            energies.with_marks(|marks| pieces(&energies.geometry, &all, marks, |f| labels[f]));
        let mut charts = Self {
            labels: vec![0; labels.len()],
            charts: Vec::new(),
        };
        charts.charts = pieces
            .into_par_iter()
            .map(|faces| energies.chart(faces, rule))
            .collect();
        charts.relabel();
        charts
    }

    fn relabel(&mut self) {
        for (label, chart) in self.charts.iter().enumerate() {
            for &f in &chart.faces {
                self.labels[f as usize] = label as u32;
            }
        }
    }

    pub fn len(&self) -> usize {
        self.charts.len()
    }

    pub fn energy(&self, rule: &Rule) -> f64 {
        self.charts
            .iter()
            .map(|chart| rule.cost(&chart.terms))
            .sum()
    }

    /// Puts another chart in the place of chart `label`.
    pub fn replace(&mut self, label: u32, chart: Arc<Chart>) {
        for &f in &chart.faces {
            self.labels[f as usize] = label;
        }
        self.charts[label as usize] = chart;
    }

    /// Puts new charts in the place of those at `removed`.
    pub fn exchange(&mut self, removed: &[u32], added: Vec<Arc<Chart>>) {
        let mut label = 0;
        self.charts.retain(|_| {
            label += 1;
            !removed.contains(&(label - 1))
        });
        self.charts.extend(added);
        self.relabel();
    }

    /// Computes all figures again where the rule asks for more of them.
    pub fn under(&self, energies: &Energies, rule: &Rule) -> Self {
        Self {
            labels: self.labels.clone(),
            charts: self
                .charts
                .par_iter()
                .map(|chart| energies.chart(chart.faces.clone(), rule))
                .collect(),
        }
    }

    pub fn seams(&self, geometry: &Geometry) -> Seams {
        seams(geometry, &self.labels)
    }
}

/// The boundaries between faces of different labels.
pub(super) fn seams(geometry: &Geometry, labels: &[u32]) -> Seams {
    let mut seams = Seams::new();
    for (f, &a) in labels.iter().enumerate() {
        for (h, g) in geometry.around(f) {
            let b = labels[g];
            if a < b {
                *seams.entry((a, b)).or_default() += geometry.costs[h];
            }
        }
    }
    seams
}

/// Connected pieces of equal label among sorted faces, each sorted, by their first faces; `label` is
/// asked for the label of the i-th face.
pub(super) fn pieces<L: PartialEq>(
    geometry: &Geometry,
    faces: &[u32],
    marks: &mut Marks,
    label: impl Fn(usize) -> L,
) -> Vec<Vec<u32>> {
    marks.place(geometry, faces);
    let mut taken = vec![false; faces.len()];
    let mut pieces = Vec::new();
    for seed in 0..faces.len() {
        if taken[seed] {
            continue;
        }
        taken[seed] = true;
        let mut piece = vec![faces[seed]];
        let mut head = 0;
        while let Some(&f) = piece.get(head) {
            head += 1;
            for (_, g) in geometry.around(f as usize) {
                if let Some(j) = marks.face(g)
                    && !taken[j]
                    && label(j) == label(seed)
                {
                    taken[j] = true;
                    piece.push(g as u32);
                }
            }
        }
        piece.sort_unstable();
        pieces.push(piece);
    }
    pieces
}

/// Gives the pieces of faces below `smallest` area, smallest first, to the piece with which they
/// share the longest boundary; `piece` has the piece of each face, and is changed.
pub(super) fn join_small(
    geometry: &Geometry,
    pieces: Vec<Vec<u32>>,
    smallest: f64,
) -> Vec<Vec<u32>> {
    let mut areas: Vec<f64> = pieces.iter().map(|piece| geometry.area_of(piece)).collect();
    if areas.iter().all(|&area| area >= smallest) {
        return pieces;
    }
    let mut owner = vec![NONE; geometry.n_faces()];
    let mut faces = Vec::new();
    for (label, piece) in (0..).zip(&pieces) {
        for &f in piece {
            owner[f as usize] = label;
        }
        faces.extend_from_slice(piece);
    }
    faces.sort_unstable();
    let mut shared: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); pieces.len()];
    for f in faces {
        let a = owner[f as usize];
        for (h, g) in geometry.around(f as usize) {
            let b = owner[g];
            if b != NONE && a != b {
                *shared[a as usize].entry(b as usize).or_default() += geometry.costs[h];
            }
        }
    }
    let mut pieces: Vec<Option<Vec<u32>>> = pieces.into_iter().map(Some).collect();
    loop {
        let small = (0..pieces.len())
            .filter(|&a| pieces[a].is_some() && areas[a] < smallest && !shared[a].is_empty())
            .min_by(|&a, &b| areas[a].total_cmp(&areas[b]).then(a.cmp(&b)));
        let Some(a) = small else { break };
        let Some((&b, _)) = shared[a].iter().max_by(|x, y| x.1.total_cmp(y.1)) else {
            break;
        };
        for (c, length) in std::mem::take(&mut shared[a]) {
            shared[c].remove(&a);
            if c != b {
                *shared[c].entry(b).or_default() += length;
                *shared[b].entry(c).or_default() += length;
            }
        }
        areas[b] += areas[a];
        if let Some(piece) = pieces[a].take()
            && let Some(other) = &mut pieces[b]
        {
            *other = union(other, &piece);
        }
    }
    pieces.into_iter().flatten().collect()
}
