//! First cells: Ward clustering of unit normals and centroids on the graph of the faces.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeSet, BinaryHeap};

use super::geometry::Geometry;

/// Cost of a merge with the two clusters and how often each had changed.
#[derive(PartialEq)]
struct Candidate {
    cost: f64,
    clusters: [u32; 2],
    versions: [u32; 2],
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost
            .total_cmp(&other.cost)
            .then(self.clusters.cmp(&other.clusters))
            .then(self.versions.cmp(&other.versions))
    }
}

struct Cluster {
    mean: [f64; 6],
    area: f64,
    version: u32,
    alive: bool,
    neighbours: BTreeSet<u32>,
}

/// Growth of the area-weighted variance where two clusters merge.
fn cost(a: &Cluster, b: &Cluster) -> f64 {
    let squares: f64 = a
        .mean
        .iter()
        .zip(&b.mean)
        .map(|(x, y)| (x - y) * (x - y))
        .sum();
    squares * a.area * b.area / (a.area + b.area)
}

/// Label of each face, for `count` connected clusters.
pub(super) fn cells(geometry: &Geometry, count: usize) -> Vec<u32> {
    let m = geometry.n_faces();
    let mut clusters: Vec<Cluster> = (0..m)
        .map(|f| Cluster {
            mean: std::array::from_fn(|i| {
                if i < 3 {
                    geometry.normals[f][i]
                } else {
                    geometry.centroids[f][i - 3]
                }
            }),
            area: geometry.areas[f],
            version: 0,
            alive: true,
            neighbours: geometry.around(f).map(|(_, g)| g as u32).collect(),
        })
        .collect();
    let candidate = |clusters: &[Cluster], a: u32, b: u32| {
        let (a, b) = (a.min(b), a.max(b));
        let (x, y) = (&clusters[a as usize], &clusters[b as usize]);
        Reverse(Candidate {
            cost: cost(x, y),
            clusters: [a, b],
            versions: [x.version, y.version],
        })
    };
    let mut heap = BinaryHeap::with_capacity(3 * m);
    for f in 0..m {
        for (_, g) in geometry.around(f).filter(|&(_, g)| f < g) {
            heap.push(candidate(&clusters, f as u32, g as u32));
        }
    }
    let mut parents: Vec<u32> = (0..m as u32).collect();
    let mut left = m;
    while left > count.max(1) {
        let Some(Reverse(Candidate {
            clusters: [a, b],
            versions,
            ..
        })) = heap.pop()
        else {
            break;
        };
        let current = [a, b].map(|c| &clusters[c as usize]);
        if current
            .iter()
            .zip(versions)
            .any(|(c, version)| !c.alive || c.version != version)
        {
            continue;
        }
        // The one with fewer neighbours goes.
        let (kept, gone) = if current[0].neighbours.len() < current[1].neighbours.len() {
            (b, a)
        } else {
            (a, b)
        };
        let moved = std::mem::take(&mut clusters[gone as usize].neighbours);
        clusters[gone as usize].alive = false;
        parents[gone as usize] = kept;
        let (mean, area) = (clusters[gone as usize].mean, clusters[gone as usize].area);
        let cluster = &mut clusters[kept as usize];
        let total = cluster.area + area;
        for (x, y) in cluster.mean.iter_mut().zip(mean) {
            *x = (*x * cluster.area + y * area) / total;
        }
        cluster.area = total;
        cluster.version += 1;
        cluster.neighbours.remove(&gone);
        for &c in moved.iter().filter(|&&c| c != kept) {
            clusters[kept as usize].neighbours.insert(c);
            clusters[c as usize].neighbours.remove(&gone);
            clusters[c as usize].neighbours.insert(kept);
        }
        for &c in &clusters[kept as usize].neighbours {
            heap.push(candidate(&clusters, kept, c));
        }
        left -= 1;
    }
    let mut labels = parents.clone();
    for label in &mut labels {
        while parents[*label as usize] != *label {
            *label = parents[*label as usize];
        }
    }
    labels
}
