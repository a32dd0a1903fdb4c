//! Splitting of faces by k-means of their normals and centroids.

use super::charts::{join_small, pieces};
use super::energy::Energies;
use crate::random::Random;

const ITERATIONS: usize = 20;

/// Connected pieces of about `count` clusters of sorted faces; pieces below `smallest` area are
/// joined to others. `normals` is the weight of the unit normals against the centroids, in roots of
/// the area of the faces.
pub(super) fn split(
    energies: &Energies,
    faces: &[u32],
    count: usize,
    normals: f64,
    smallest: f64,
    random: &mut Random,
) -> Vec<Vec<u32>> {
    let geometry = &energies.geometry;
    let scale = 1.0 / geometry.area_of(faces).sqrt();
    let points: Vec<[f64; 6]> = faces
        .iter()
        .map(|&f| {
            let (normal, centroid) = (geometry.normals[f as usize], geometry.centroids[f as usize]);
            std::array::from_fn(|i| {
                if i < 3 {
                    normals * normal[i]
                } else {
                    scale * centroid[i - 3]
                }
            })
        })
        .collect();
    let mut clusters = k_means(&points, count.min(faces.len()), random);
    geometry.unite(faces, &mut clusters);
    let parts = energies.with_marks(|marks| pieces(geometry, faces, marks, |i| clusters[i]));
    join_small(geometry, parts, smallest)
}

fn square(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// Cluster of each point: Lloyd's iterations from the spread start of Arthur and Vassilvitskii
/// (2007).
fn k_means(points: &[[f64; 6]], count: usize, random: &mut Random) -> Vec<u32> {
    let mut centres = vec![points[random.below(points.len())]];
    let mut squares = vec![f64::INFINITY; points.len()];
    while centres.len() < count {
        let last = centres[centres.len() - 1];
        for (least, point) in squares.iter_mut().zip(points) {
            *least = least.min(square(point, &last));
        }
        centres.push(points[random.weighted(&squares)]);
    }
    let mut clusters = vec![0; points.len()];
    for _ in 0..ITERATIONS {
        let mut changed = false;
        for (cluster, point) in clusters.iter_mut().zip(points) {
            let mut best = (f64::INFINITY, 0);
            for (k, centre) in centres.iter().enumerate() {
                let distance = square(point, centre);
                if distance < best.0 {
                    best = (distance, k as u32);
                }
            }
            changed |= *cluster != best.1;
            *cluster = best.1;
        }
        if !changed {
            break;
        }
        let mut sums = vec![([0.0; 6], 0.0); count];
        for (&cluster, point) in clusters.iter().zip(points) {
            let (sum, n) = &mut sums[cluster as usize];
            for (total, x) in sum.iter_mut().zip(point) {
                *total += x;
            }
            *n += 1.0;
        }
        for (centre, (sum, n)) in centres.iter_mut().zip(sums) {
            if n > 0.0 {
                *centre = sum.map(|x| x / n);
            }
        }
    }
    clusters
}
