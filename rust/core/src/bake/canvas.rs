//! The image that is painted, and the gutters between its charts.

use std::ops::Range;

use rayon::prelude::*;

use crate::error::{Result, try_filled};
use crate::raster::STRIP;

pub(super) const CHANNELS: usize = 3;

/// Bytes that baking takes for each texel: three for its colour, two for the way to
/// the nearest painted one.
pub const BYTES_PER_TEXEL: usize = CHANNELS + size_of::<i16>();

/// No texel of the column is painted.
const NOWHERE: i16 = i16::MIN;

/// An image and which of its texels are painted.
#[derive(Debug)]
pub(super) struct Canvas {
    resolution: usize,
    /// Rows from the top (v = 1) down.
    image: Vec<u8>,
    /// Rows from each texel down to the nearest painted one in its column, negative for up: 0 where
    /// the texel is painted.
    reach: Vec<i16>,
}

/// Some rows of a canvas.
pub(super) struct Strip<'a> {
    pixels: &'a mut [[u8; CHANNELS]],
    reach: &'a mut [i16],
}

impl Strip<'_> {
    /// Paints a texel, numbered from the first one of the strip, in a colour of channels in [0, 1].
    pub(super) fn paint(&mut self, texel: usize, colour: [f64; CHANNELS]) {
        self.pixels[texel] = colour.map(|x| (x.clamp(0.0, 1.0) * 255.0).round_ties_even() as u8);
        self.reach[texel] = 0;
    }
}

impl Canvas {
    pub(super) fn new(resolution: usize, background: [u8; CHANNELS]) -> Result<Self> {
        let texels = resolution * resolution;
        let mut image = try_filled("resolution", CHANNELS * texels, background[0])?;
        if background != [background[0]; CHANNELS] {
            image.as_chunks_mut().0.fill(background);
        }
        Ok(Self {
            resolution,
            image,
            reach: try_filled("resolution", texels, NOWHERE)?,
        })
    }

    /// The strips in turn, for writing.
    pub(super) fn strips(
        &mut self,
        strips: Range<usize>,
    ) -> impl IndexedParallelIterator<Item = Strip<'_>> {
        let texels = self.texels(&strips);
        let length = STRIP * self.resolution;
        let (pixels, _) = self.image.as_chunks_mut::<CHANNELS>();
        pixels[texels.clone()]
            .par_chunks_mut(length)
            .zip(self.reach[texels].par_chunks_mut(length))
            .map(|(pixels, reach)| Strip { pixels, reach })
    }

    /// Measures the reach of what is not painted.
    pub(super) fn prepare_gutters(&mut self) {
        let n = self.resolution;
        for row in 1..n {
            let (above, here) = self.reach[(row - 1) * n..(row + 1) * n].split_at_mut(n);
            for (here, &above) in here.iter_mut().zip(&*above) {
                if *here == NOWHERE && above != NOWHERE {
                    *here = above - 1;
                }
            }
        }
        // All numbers are at most 0 by now, and -NOWHERE is more than any distance.
        let mut below = vec![-i32::from(NOWHERE); n];
        for here in self.reach.chunks_exact_mut(n).rev() {
            for (here, below) in here.iter_mut().zip(&mut below) {
                if *here == 0 {
                    *below = 0;
                    continue;
                }
                *below += 1;
                // Of two equally near the upper one counts.
                if *below < -i32::from(*here) {
                    *here = *below as i16;
                }
            }
        }
    }

    /// Gives every texel of the strips that is not painted the colour of the nearest one that is,
    /// at most `padding` texels away; of several the leftmost counts.
    ///
    /// The nearest one of a row's texel is the nearest one in some column: the columns are parabolas
    /// of squared distance over the row, whose lower envelope is found in one pass (Maurer, Qi and
    /// Raghavan 2003), in whole numbers.
    pub(super) fn fill_gutters(&mut self, strips: Range<usize>, padding: Option<usize>) {
        let n = self.resolution;
        let texels = self.texels(&strips);
        let (pixels, _) = self.image.as_chunks::<CHANNELS>();
        let mut filled = pixels[texels.clone()].to_vec();
        let limit = padding.map_or(i64::MAX, |padding| square(padding.min(2 * n) as i64));
        filled
            .par_chunks_mut(n)
            .zip(self.reach[texels.clone()].par_chunks(n))
            .enumerate()
            .for_each_init(Vec::new, |envelope, (offset, (target, reach))| {
                if reach.iter().all(|&reach| reach == 0) {
                    return;
                }
                lower_envelope(reach, limit, envelope);
                let row = (texels.start / n + offset) as i64;
                let mut nearest = envelope.iter().peekable();
                let Some(mut parabola) = nearest.next() else {
                    return;
                };
                for (column, (pixel, &reach)) in target.iter_mut().zip(reach).enumerate() {
                    let column = column as i64;
                    while let Some(next) =
                        nearest.next_if(|next| next.at(column) < parabola.at(column))
                    {
                        parabola = next;
                    }
                    if reach != 0 && parabola.at(column) <= limit {
                        let source = (row + parabola.reach) * n as i64 + parabola.column;
                        *pixel = pixels[source as usize];
                    }
                }
            });
        let (pixels, _) = self.image.as_chunks_mut::<CHANNELS>();
        pixels[texels].copy_from_slice(&filled);
    }

    pub(super) fn into_image(self) -> Vec<u8> {
        self.image
    }

    fn texels(&self, strips: &Range<usize>) -> Range<usize> {
        let n = self.resolution;
        (strips.start * STRIP).min(n) * n..(strips.end * STRIP).min(n) * n
    }
}

/// The nearest painted texel of a column, as seen from the texels of one row.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    column: i64,
    reach: i64,
}

impl Parabola {
    /// Squared distance from a texel of the row.
    fn at(&self, column: i64) -> i64 {
        square(column - self.column) + square(self.reach)
    }
}

fn square(x: i64) -> i64 {
    x * x
}

/// The parabolas of a row that are lowest somewhere, from the left; columns whose nearest painted
/// texel is more than the root of `limit` away are left out.
fn lower_envelope(reach: &[i16], limit: i64, envelope: &mut Vec<Parabola>) {
    envelope.clear();
    for (column, &reach) in reach.iter().enumerate() {
        let new = Parabola {
            column: column as i64,
            reach: i64::from(reach),
        };
        if reach == NOWHERE || square(new.reach) > limit {
            continue;
        }
        while let [.., first, second] = envelope[..] {
            let (left, right) = (second.column - first.column, new.column - second.column);
            let both = left + right;
            // Whether the second is lower than the other two where these meet, or as low.
            let gap = both * square(second.reach)
                - right * square(first.reach)
                - left * square(new.reach);
            if gap <= left * right * both {
                break;
            }
            envelope.pop();
        }
        envelope.push(new);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::numbers;

    /// A canvas where one in `rarity` texels is painted, each in a colour of its own.
    fn canvas(resolution: usize, rarity: u32, seed: u64) -> Canvas {
        let mut number = numbers(seed);
        let mut canvas = Canvas::new(resolution, [9, 8, 7]).unwrap();
        let strips = resolution.div_ceil(STRIP);
        canvas.image.as_chunks_mut::<CHANNELS>().0.fill([9, 8, 7]);
        for texel in 0..resolution * resolution {
            if number().is_multiple_of(rarity) {
                canvas.image[CHANNELS * texel..][..CHANNELS].copy_from_slice(&[
                    (texel / 200) as u8,
                    (texel % 200) as u8,
                    200,
                ]);
                canvas.reach[texel] = 0;
            }
        }
        assert_eq!(canvas.texels(&(0..strips)).end, resolution * resolution);
        canvas
    }

    /// The fill by definition: all painted texels are tried.
    fn slow_fill(canvas: &Canvas, padding: Option<usize>) -> Vec<u8> {
        let n = canvas.resolution as i64;
        let painted: Vec<i64> = (0..n * n)
            .filter(|&texel| canvas.reach[texel as usize] == 0)
            .collect();
        let mut image = canvas.image.clone();
        for texel in 0..n * n {
            let nearest = painted
                .iter()
                .map(|&source| {
                    let (down, right) = (source / n - texel / n, source % n - texel % n);
                    (down * down + right * right, source % n, source / n)
                })
                .min();
            if let Some((distance, column, row)) = nearest
                && padding.is_none_or(|padding| distance <= (padding * padding) as i64)
            {
                let source = (row * n + column) as usize * CHANNELS;
                let target = texel as usize * CHANNELS;
                image[target..target + CHANNELS]
                    .copy_from_slice(&canvas.image[source..source + CHANNELS]);
            }
        }
        image
    }

    #[test]
    fn gutters_copy_the_nearest_texel() {
        for (resolution, rarity, seed) in
            [(1, 1, 1), (1, 9, 2), (7, 5, 3), (33, 40, 4), (50, 500, 5)]
        {
            for padding in [None, Some(1), Some(3), Some(1000)] {
                let mut canvas = canvas(resolution, rarity, seed);
                let expected = slow_fill(&canvas, padding);
                canvas.prepare_gutters();
                for strip in 0..resolution.div_ceil(STRIP) {
                    canvas.fill_gutters(strip..strip + 1, padding);
                }
                assert_eq!(canvas.image, expected, "{resolution} {rarity} {padding:?}");
            }
        }
    }

    #[test]
    fn colours_are_rounded_and_clipped() {
        let mut canvas = Canvas::new(2, [1, 2, 3]).unwrap();
        canvas.strips(0..1).for_each(|mut strip| {
            strip.paint(1, [-3.0, 0.5, 7.0]);
        });
        assert_eq!(canvas.image[..6], [1, 2, 3, 0, 128, 255]);
    }
}
