//! Vertices at one place.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::mesh::distance;

/// For each vertex the first one that stands at its place; those not in use stand for themselves.
///
/// Places are equal where all coordinates are; 0.0 and -0.0 are. With a positive `tolerance`, a
/// vertex also goes to the first one nearer than that which did not go to another itself: no chain
/// of vertices grows longer than the tolerance.
pub(super) fn weld(positions: &[[f64; 3]], used: &[bool], tolerance: f64) -> Vec<u32> {
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    let mut keys: Vec<([u64; 3], u32)> = (0..positions.len())
        .filter(|&v| used[v])
        // The sum has no negative zero.
        .map(|v| (positions[v].map(|x| (x + 0.0).to_bits()), v as u32))
        .collect();
    keys.par_sort_unstable();
    for run in keys.chunk_by(|a, b| a.0 == b.0) {
        for &(_, v) in run {
            first[v as usize] = run[0].1;
        }
    }
    if tolerance > 0.0 {
        let near = join_near(positions, used, &first, tolerance);
        for v in &mut first {
            *v = near[*v as usize];
        }
    }
    first
}

fn join_near(positions: &[[f64; 3]], used: &[bool], first: &[u32], tolerance: f64) -> Vec<u32> {
    let mut near: Vec<u32> = first.to_vec();
    // Cells as wide as the tolerance: what is near is in one of 27, and those in a cell are apart.
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for v in 0..positions.len() {
        if !used[v] || first[v] as usize != v {
            continue;
        }
        let place = positions[v];
        let cell = place.map(|x| (x / tolerance).floor() as i64);
        let around = (0..27).filter_map(|k| {
            let offset = [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
            cells.get(&[0, 1, 2].map(|i| cell[i].saturating_add(offset[i])))
        });
        let joined = around
            .flatten()
            .copied()
            .filter(|&w| distance(positions[w as usize], place) < tolerance)
            .min();
        match joined {
            Some(w) => near[v] = w,
            None => cells.entry(cell).or_default().push(v as u32),
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_places_go_to_the_first() {
        let positions = [[0.0; 3], [1.0; 3], [-0.0, 0.0, -0.0], [1.0; 3]];
        assert_eq!(weld(&positions, &[true; 4], 0.0), [0, 1, 0, 1]);
        assert_eq!(
            weld(&positions, &[false, true, true, true], 0.0),
            [0, 1, 2, 1]
        );
        let next = [[0.5; 3], [0.5_f64.next_up(), 0.5, 0.5]];
        assert_eq!(weld(&next, &[true; 2], 0.0), [0, 1]);
    }

    #[test]
    fn near_places_make_no_chain() {
        let line: Vec<_> = (0..7).map(|k| [f64::from(k) * 0.75, 0.0, 0.0]).collect();
        assert_eq!(weld(&line, &[true; 7], 1.0), [0, 0, 2, 2, 4, 4, 6]);
    }
}
