//! Pieces of the plane side by side in a square.
//!
//! Pieces are turned and moved, never mirrored, and share one scale. They are drawn on a grid in
//! rows of bits, each in two shapes: the cells that it touches, and the cells that are nearer to it
//! than the gap. A piece may lie where the first shape of it meets the second shape of no other, so
//! every layout keeps the gap exactly, whatever the size of a cell. Where a piece may lie in a row
//! is found for all columns at once. What is sought is an order of the pieces that lets them into a
//! small square, each placed as low as it can be. Few pieces are then drawn apart at any angle in a
//! shrinking square; very many are placed once, each above the last one of its size.

mod mask;
mod piece;
mod search;
mod separate;
mod shape;
mod sheet;

use rayon::prelude::*;

use crate::error::{Error, Result, check_length};
use piece::Piece;

/// The least distance of two pieces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gap {
    /// As a share of the side of the square.
    Share(f64),
    /// In the units of the points, whatever the side becomes.
    Length(f64),
}

impl Gap {
    /// The gap where pieces, `scale` times as large, reach over an extent: the side without it.
    fn at(self, scale: f64, extent: f64) -> f64 {
        match self {
            Self::Share(share) => share * extent / (1.0 - share),
            Self::Length(length) => length * scale,
        }
    }

    fn value(self) -> f64 {
        match self {
            Self::Share(value) | Self::Length(value) => value,
        }
    }
}

/// Lays triangles into the unit square, piece by piece, without overlap.
///
/// `points` are the corners that `triangles` name, `piece` says which piece each triangle belongs
/// to. `padding` is the least distance of two pieces; half of it is kept free along the border. The
/// result holds the corners of the triangles in [0, 1]^2: those of a piece turned and moved, all
/// pieces scaled alike. It does not depend on the number of threads.
///
/// # Errors
/// A point that is not finite, an index out of range, a padding that leaves no room for so many
/// pieces, more pieces than the search has cells for.
pub fn pack(
    points: &[[f64; 2]],
    triangles: &[[i64; 3]],
    piece: &[i64],
    padding: Gap,
) -> Result<Vec<[[f64; 2]; 3]>> {
    check_length("piece", piece.len(), triangles.len())?;
    if let Some(index) = points.as_flattened().iter().position(|x| !x.is_finite()) {
        return Err(Error::NonFinite {
            argument: "points",
            index: index / 2,
            value: points[index / 2][index % 2],
        });
    }
    check_indices("triangles", triangles.as_flattened(), points.len())?;
    check_indices("piece", piece, triangles.len())?;
    if triangles.is_empty() {
        return Ok(Vec::new());
    }
    let members = piece::members(piece);
    let pieces: Vec<Piece> = members
        .par_iter()
        .map(|faces| Piece::new(points, triangles, faces))
        .collect();
    let most = match padding {
        Gap::Share(_) => most_padding(pieces.len()),
        Gap::Length(_) => f64::MAX,
    };
    if !(0.0..=most).contains(&padding.value()) {
        return Err(Error::OutsideRange {
            argument: "padding",
            index: 0,
            value: padding.value(),
            low: 0.0,
            high: most,
        });
    }
    let layout = search::search(&pieces, padding)?;
    let mut uv = vec![[[0.0; 2]; 3]; triangles.len()];
    for ((faces, piece), place) in members.iter().zip(&pieces).zip(&layout.places) {
        for (&face, corners) in faces.iter().zip(piece.triangles()) {
            uv[face as usize] = corners.map(|corner| layout.unit_square(place, corner));
        }
    }
    Ok(uv)
}

/// Largest padding that always leaves room for `count` pieces: half of the side, were they in a
/// square grid.
#[must_use]
pub fn most_padding(count: usize) -> f64 {
    0.5 / (count as f64).sqrt()
}

fn check_indices(argument: &'static str, indices: &[i64], count: usize) -> Result<()> {
    let wrong = |&index: &i64| index < 0 || index as u64 >= count as u64;
    match indices.iter().position(wrong) {
        None => Ok(()),
        Some(position) => Err(Error::Index {
            argument,
            position,
            index: indices[position],
            count,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares(count: usize) -> (Vec<[f64; 2]>, Vec<[i64; 3]>, Vec<i64>) {
        let mut points = Vec::new();
        let mut triangles = Vec::new();
        for k in 0..count as i64 {
            points.extend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
            triangles.extend([[0, 1, 2], [0, 2, 3]].map(|face: [i64; 3]| face.map(|v| v + 4 * k)));
        }
        let piece = (0..2 * count as i64).map(|face| face / 2).collect();
        (points, triangles, piece)
    }

    #[test]
    fn squares_fill_the_square() {
        let (points, triangles, piece) = squares(16);
        let uv = pack(&points, &triangles, &piece, Gap::Share(0.0)).unwrap();
        let area = |[a, b, c]: [[f64; 2]; 3]| {
            0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
        };
        let total: f64 = uv.iter().map(|&corners| area(corners)).sum();
        assert!(total > 0.95, "{total}");
        assert!(
            uv.as_flattened()
                .as_flattened()
                .iter()
                .all(|x| (0.0..=1.0).contains(x))
        );
    }

    #[test]
    fn the_largest_padding_leaves_room() {
        for count in [1, 2, 50] {
            let (points, triangles, piece) = squares(count);
            let padding = most_padding(count);
            let uv = pack(&points, &triangles, &piece, Gap::Share(padding)).unwrap();
            assert!(uv.iter().all(|corners| corners[0] != corners[1]));
            assert!(pack(&points, &triangles, &piece, Gap::Share(1.01 * padding)).is_err());
        }
    }

    #[test]
    fn a_gap_far_beyond_the_pieces_takes_no_memory() {
        let (points, triangles, piece) = squares(3);
        for length in [1e3, 1e6, 1e9] {
            // Either there is room or there is none.
            if let Ok(uv) = pack(&points, &triangles, &piece, Gap::Length(length)) {
                assert!(
                    uv.iter()
                        .flatten()
                        .flatten()
                        .all(|x| (0.0..=1.0).contains(x))
                );
            }
            let one = vec![0; piece.len()];
            assert!(pack(&points, &triangles, &one, Gap::Length(length)).is_ok());
        }
    }

    #[test]
    fn a_gap_as_a_length_is_kept_in_the_units_of_the_points() {
        for (count, length) in [(2, 0.3), (9, 0.05), (30, 4.0), (500, 0.1), (500, 20.0)] {
            let (points, triangles, piece) = squares(count);
            let uv = pack(&points, &triangles, &piece, Gap::Length(length)).unwrap();
            let side = |[a, b, _]: [[f64; 2]; 3]| (b[0] - a[0]).hypot(b[1] - a[1]);
            let scale = side(uv[0]);
            let centres: Vec<[f64; 2]> = uv
                .chunks(2)
                .map(|faces| [0, 1].map(|k| 0.5 * (faces[0][0][k] + faces[0][2][k])))
                .collect();
            // Inscribed circles have twice half a side between their centres, and the gap.
            for (i, a) in centres.iter().enumerate() {
                for b in &centres[..i] {
                    let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
                    assert!(apart >= scale * (1.0 + length) * (1.0 - 1e-6), "{apart}");
                }
            }
            // No other squares would fill more than a grid of them, turned or not.
            let cells = (count as f64).sqrt().ceil();
            assert!(scale * cells * (1.0 + length) > 0.75, "{count}: {scale}");
        }
    }

    #[test]
    fn nothing_is_no_layout() {
        assert_eq!(
            pack(&[], &[], &[], Gap::Share(0.0)).unwrap(),
            Vec::<[[f64; 2]; 3]>::new()
        );
    }
}
