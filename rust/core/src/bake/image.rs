//! Lookup in an image that repeats over the plane.

use crate::error::{Error, Result};

/// An image over [0, 1]^2, its first row at v = 1, that repeats over the plane; values between the
/// texel centres are bilinear.
#[derive(Debug, Clone, Copy)]
pub struct Image<'a> {
    texels: Texels<'a>,
    height: usize,
    width: usize,
    channels: usize,
}

#[derive(Debug, Clone, Copy)]
enum Texels<'a> {
    Bytes(&'a [u8]),
    Floats(&'a [f64]),
}

/// The four texels around a place, upper row first, and their weights by row and by column.
struct Around {
    texels: [[usize; 2]; 2],
    rows: [f64; 2],
    columns: [f64; 2],
}

impl<'a> Image<'a> {
    /// Takes an image of bytes, which stand for multiples of 1 / 255, and its shape: height, width,
    /// channels.
    ///
    /// # Errors
    /// `texels` that do not fill the shape, or an empty shape.
    pub fn from_bytes(texels: &'a [u8], shape: [usize; 3]) -> Result<Self> {
        Self::new(Texels::Bytes(texels), texels.len(), shape)
    }

    /// Takes an image of floating-point numbers and its shape: height, width, channels.
    ///
    /// # Errors
    /// As [`Self::from_bytes`].
    pub fn from_floats(texels: &'a [f64], shape: [usize; 3]) -> Result<Self> {
        Self::new(Texels::Floats(texels), texels.len(), shape)
    }

    fn new(texels: Texels<'a>, length: usize, shape: [usize; 3]) -> Result<Self> {
        let [height, width, channels] = shape;
        if length == 0 || length != height * width * channels {
            return Err(Error::Image { length, shape });
        }
        Ok(Self {
            texels,
            height,
            width,
            channels,
        })
    }

    /// Number of values at a texel.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Writes the values of all channels at a place to `values`.
    pub fn sample(&self, place: [f64; 2], values: &mut [f64]) {
        let around = self.around(place);
        for (channel, value) in values.iter_mut().enumerate().take(self.channels) {
            *value = self.mean(&around, channel);
        }
    }

    /// The colour at a place: the first three channels, or the first one thrice.
    pub(super) fn colour(&self, place: [f64; 2]) -> [f64; 3] {
        let around = self.around(place);
        if self.channels < 3 {
            [self.mean(&around, 0); 3]
        } else {
            [0, 1, 2].map(|channel| self.mean(&around, channel))
        }
    }

    #[inline]
    fn around(&self, [u, v]: [f64; 2]) -> Around {
        // Whole tiles are taken off first: far from the origin the interpolation would lose digits.
        let y = (1.0 - (v - v.floor())) * self.height as f64 - 0.5;
        let x = (u - u.floor()) * self.width as f64 - 0.5;
        let (rows, row_weights) = wrap(y, self.height);
        let (columns, column_weights) = wrap(x, self.width);
        Around {
            texels: rows.map(|row| columns.map(|column| row * self.width + column)),
            rows: row_weights,
            columns: column_weights,
        }
    }

    #[inline]
    fn mean(&self, around: &Around, channel: usize) -> f64 {
        let mut sum = 0.0;
        for (row, row_weight) in around.texels.iter().zip(around.rows) {
            for (&texel, column_weight) in row.iter().zip(around.columns) {
                let index = texel * self.channels + channel;
                let value = match self.texels {
                    Texels::Bytes(bytes) => f64::from(bytes[index]) / 255.0,
                    Texels::Floats(floats) => floats[index],
                };
                sum += value * row_weight * column_weight;
            }
        }
        sum
    }
}

/// The two texels on both sides of a coordinate in -1/2..=size - 1/2, and their weights.
#[inline]
fn wrap(x: f64, size: usize) -> ([usize; 2], [f64; 2]) {
    let x = if x < 0.0 { x + size as f64 } else { x };
    let first = (x as usize).min(size - 1);
    let next = if first + 1 == size { 0 } else { first + 1 };
    let fraction = x - first as f64;
    ([first, next], [1.0 - fraction, fraction])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_between_centres() {
        let image = Image::from_floats(&[0.0, 1.0, 2.0, 3.0], [2, 2, 1]).unwrap();
        assert_eq!(image.colour([0.25, 0.75]), [0.0; 3]);
        assert_eq!(image.colour([0.75, 0.25]), [3.0; 3]);
        assert_eq!(image.colour([0.5, 0.5]), [1.5; 3]);
        // Across the boundary of the tile.
        assert_eq!(image.colour([0.0, 0.75]), [0.5; 3]);
        assert_eq!(image.colour([1.0, 0.75]), [0.5; 3]);
    }

    #[test]
    fn repeats_over_the_plane() {
        let bytes: Vec<u8> = (0..60).map(|k| k * 4).collect();
        let image = Image::from_bytes(&bytes, [4, 5, 3]).unwrap();
        for k in 0..50 {
            let (u, v) = (0.02 * f64::from(k), 0.37 + 0.013 * f64::from(k));
            let (here, there) = (image.colour([u, v]), image.colour([u - 3.0, v + 8.0]));
            for (a, b) in here.iter().zip(there) {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn one_texel_is_a_constant() {
        let image = Image::from_bytes(&[51, 102, 255], [1, 1, 3]).unwrap();
        for place in [[0.0, 0.0], [0.999, -1e-20], [-7.3, 12.6]] {
            for (a, b) in image.colour(place).iter().zip([0.2, 0.4, 1.0]) {
                assert!((a - b).abs() < 1e-15, "{place:?}");
            }
        }
    }

    #[test]
    fn shapes_are_checked() {
        assert!(Image::from_bytes(&[0; 5], [1, 2, 3]).is_err());
        assert!(Image::from_floats(&[], [0, 2, 3]).is_err());
    }
}
