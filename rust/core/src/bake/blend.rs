//! What the charts contribute to the texels of a layout.

use super::charts::{Charts, Sample};
use crate::error::{Error, Result};
use crate::raster::{STRIP, Strips};

/// No face covers the texel.
const NONE: u32 = u32::MAX;

/// A layout and the charts of its faces.
#[derive(Debug)]
pub(super) struct Blend {
    strips: Strips<Vec<[f64; 2]>>,
    charts: Charts,
    /// Tiles of the texture per unit of length.
    scale: f64,
}

impl Blend {
    pub(super) fn new(strips: Strips<Vec<[f64; 2]>>, charts: Charts, scale: f64) -> Self {
        Self {
            strips,
            charts,
            scale,
        }
    }

    pub(super) fn resolution(&self) -> usize {
        self.strips.resolution()
    }

    pub(super) fn n_strips(&self) -> usize {
        self.strips.len()
    }

    /// Calls `each` with every covered texel of a strip, row by row, and the samples that its
    /// colour is the weighted mean of. Texels are numbered from the first one of the strip.
    ///
    /// # Errors
    /// A face without a chart of positive weight.
    pub(super) fn visit(&self, strip: usize, mut each: impl FnMut(usize, &[Sample])) -> Result<()> {
        let resolution = self.resolution();
        let top = strip * STRIP;
        let rows = STRIP.min(resolution - top);
        let mut faces = vec![NONE; rows * resolution];
        self.strips.cover(strip, |face, texels| {
            for owner in &mut faces[texels] {
                // The lowest of several faces counts; they come in order.
                if *owner == NONE {
                    *owner = face as u32;
                }
            }
        });
        let mut samples = Vec::new();
        for (row, faces) in faces.chunks_exact(resolution).enumerate() {
            let v = (resolution - 1 - top - row) as f64 + 0.5;
            for (column, &face) in faces.iter().enumerate() {
                if face == NONE {
                    continue;
                }
                let face = face as usize;
                let centre = [column as f64 + 0.5, v].map(|x| x / resolution as f64);
                let weights = barycentric(self.strips.corners(face), centre);
                self.charts.sample(face, weights, self.scale, &mut samples);
                if samples.is_empty() {
                    return Err(Error::Uncharted { face });
                }
                each(row * resolution + column, &samples);
            }
        }
        Ok(())
    }
}

/// Barycentric coordinates of a point of a triangle.
fn barycentric(corners: &[[f64; 2]; 3], point: [f64; 2]) -> [f64; 3] {
    let from_first = |q: [f64; 2]| [q[0] - corners[0][0], q[1] - corners[0][1]];
    let [a, b, p] = [corners[1], corners[2], point].map(from_first);
    let area = a[0] * b[1] - a[1] * b[0];
    let second = (p[0] * b[1] - p[1] * b[0]) / area;
    let third = (a[0] * p[1] - a[1] * p[0]) / area;
    // Covered texels lie inside up to rounding, which a sliver's small area magnifies.
    let clipped = [1.0 - second - third, second, third].map(|x| x.clamp(0.0, 1.0));
    let sum: f64 = clipped.iter().sum();
    clipped.map(|x| x / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn barycentrics_give_the_point_back() {
        let corners = [[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]];
        let weights = barycentric(&corners, [0.45, 0.4]);
        for (axis, expected) in [0.45, 0.4].into_iter().enumerate() {
            let value: f64 = (0..3).map(|k| weights[k] * corners[k][axis]).sum();
            assert!((value - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn barycentrics_stay_inside() {
        let sliver = [[0.0, 0.5], [1.0, 0.5], [0.5, 0.5 + 1e-12]];
        let weights = barycentric(&sliver, [0.25, 0.5 + 1e-6]);
        assert!(weights.iter().all(|x| (0.0..=1.0).contains(x)));
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }
}
