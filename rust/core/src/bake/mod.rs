//! Textures baked into the packed layout of an atlas, section 4.
//!
//! Every covered texel gets the blend, at its point of the surface, of a texture that overlapping
//! charts carry there; the texels around the charts copy the nearest covered one. The layout is
//! worked through in tiles, whole rows of it, which bounds the memory and lets a caller stop
//! between two of them.

mod blend;
mod canvas;
mod charts;
mod image;

use rayon::prelude::*;

use crate::error::{Result, check_length};
use crate::raster::{STRIP, Strips};
use blend::Blend;
pub use canvas::BYTES_PER_TEXEL;
use canvas::{CHANNELS, Canvas};
pub use charts::Charts;
pub use image::Image;

/// Texels of a tile, or one strip where that is more. With a place and a value of a function at each
/// of them this is some 50 MB.
const TILE: usize = 1 << 20;

/// A baked image while it is made.
///
/// Tiles are painted one after the other, each from an [`Image`] or with the values of a function
/// at the [`Bake::places`] of the tile. Gutters are filled last.
///
/// # Examples
/// ```
/// use phaseatlas_core::bake::{Bake, Charts, Image};
///
/// # fn main() -> phaseatlas_core::Result<()> {
/// // One face, which covers the lower left half of the layout and is its own chart.
/// let corners = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
/// let charts = Charts::new(1, &[0], &[[0, 1, 2]], corners.clone(), None)?;
/// let mut bake = Bake::new(corners, charts, 1.0, 64, [0, 0, 255])?;
/// let red = Image::from_bytes(&[255, 0, 0], [1, 1, 3])?;
/// for tile in 0..bake.n_tiles() {
///     bake.paint_image(tile, &red)?;
/// }
/// bake.prepare_gutters();
/// for tile in 0..bake.n_tiles() {
///     bake.fill_gutters(tile, Some(2));
/// }
/// let pixels = bake.into_image();
/// let row = 3 * 64;
/// assert_eq!(pixels[63 * row..][..3], [255, 0, 0]);
/// assert_eq!(pixels[row - 3..row], [0, 0, 255]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Bake {
    blend: Blend,
    canvas: Canvas,
}

impl Bake {
    /// Takes the corners of all faces in the layout, three a face, and the charts of the faces.
    ///
    /// `scale` is the number of tiles of the texture per unit of length of the charts, `resolution`
    /// the side of the image in texels, and `background` its colour where nothing is painted.
    ///
    /// # Errors
    /// `corners` that are not three for each face of the charts, `resolution` out of range,
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        corners: Vec<[f64; 2]>,
        charts: Charts,
        scale: f64,
        resolution: usize,
        background: [u8; 3],
    ) -> Result<Self> {
        check_length("corners", corners.len(), 3 * charts.n_faces())?;
        let strips = Strips::new(corners, resolution)?;
        Ok(Self {
            canvas: Canvas::new(resolution, background)?,
            blend: Blend::new(strips, charts, scale),
        })
    }

    /// Number of tiles.
    #[must_use]
    pub fn n_tiles(&self) -> usize {
        self.blend.n_strips().div_ceil(self.strips_per_tile())
    }

    /// Where a tile asks for the texture, in the plane of the texture: for each covered texel, row
    /// by row, one place for each chart that has a weight there.
    ///
    /// # Errors
    /// A face without a chart of positive weight.
    pub fn places(&self, tile: usize) -> Result<Vec<[f64; 2]>> {
        let strips: Vec<Result<Vec<[f64; 2]>>> = self
            .strips(tile)
            .into_par_iter()
            .map(|strip| {
                let mut places = Vec::new();
                self.blend.visit(strip, |_, samples| {
                    places.extend(samples.iter().map(|sample| sample.place));
                })?;
                Ok(places)
            })
            .collect();
        let strips: Vec<Vec<[f64; 2]>> = strips.into_iter().collect::<Result<_>>()?;
        Ok(strips.concat())
    }

    /// Paints a tile from an image that repeats over the plane.
    ///
    /// # Errors
    /// A face without a chart of positive weight.
    pub fn paint_image(&mut self, tile: usize, image: &Image<'_>) -> Result<()> {
        self.paint(tile, |_, _, place| image.colour(place))
    }

    /// Paints a tile with the values of a function at the [`Self::places`] of the tile.
    ///
    /// # Errors
    /// Another number of values than of places; a face without a chart of positive weight.
    pub fn paint_values(&mut self, tile: usize, values: &[[f64; 3]]) -> Result<()> {
        let counts: Vec<Result<usize>> = self
            .strips(tile)
            .into_par_iter()
            .map(|strip| {
                let mut count = 0;
                self.blend
                    .visit(strip, |_, samples| count += samples.len())?;
                Ok(count)
            })
            .collect();
        let (mut starts, mut total) = (Vec::new(), 0);
        for count in counts {
            starts.push(total);
            total += count?;
        }
        check_length("values", values.len(), total)?;
        self.paint(tile, |strip, index, _| values[starts[strip] + index])
    }

    /// Paints a tile; `look_up` gets the strip within the tile, the index of the sample within the
    /// strip and its place.
    fn paint(
        &mut self,
        tile: usize,
        look_up: impl Fn(usize, usize, [f64; 2]) -> [f64; CHANNELS] + Sync,
    ) -> Result<()> {
        let strips = self.strips(tile);
        let first = strips.start;
        let blend = &self.blend;
        let outcomes: Vec<Result<()>> = self
            .canvas
            .strips(strips)
            .enumerate()
            .map(|(k, mut canvas)| {
                let mut index = 0;
                blend.visit(first + k, |texel, samples| {
                    let (mut colour, mut total) = ([0.0; CHANNELS], 0.0);
                    for sample in samples {
                        let value = look_up(k, index, sample.place);
                        index += 1;
                        for (sum, value) in colour.iter_mut().zip(value) {
                            *sum += sample.weight * value;
                        }
                        total += sample.weight;
                    }
                    canvas.paint(texel, colour.map(|sum| sum / total));
                })
            })
            .collect();
        // In the order of the strips, so that the error does not depend on the threads.
        outcomes.into_iter().collect()
    }

    /// Measures how far each texel is from a painted one in its column: once, after all tiles are
    /// painted and before [`Self::fill_gutters`].
    pub fn prepare_gutters(&mut self) {
        self.canvas.prepare_gutters();
    }

    /// Copies to every texel of a tile that no face covers the colour of the nearest covered one,
    /// where that is at most `padding` texels away; [`None`] sets no limit. Of several nearest
    /// texels the one in the leftmost column counts, and of those the uppermost.
    pub fn fill_gutters(&mut self, tile: usize, padding: Option<usize>) {
        let strips = self.strips(tile);
        self.canvas.fill_gutters(strips, padding);
    }

    /// The image, three bytes a texel, rows from the top down.
    #[must_use]
    pub fn into_image(self) -> Vec<u8> {
        self.canvas.into_image()
    }

    fn strips_per_tile(&self) -> usize {
        (TILE / (STRIP * self.blend.resolution())).max(1)
    }

    fn strips(&self, tile: usize) -> std::ops::Range<usize> {
        let (count, per_tile) = (self.blend.n_strips(), self.strips_per_tile());
        (tile * per_tile).min(count)..((tile + 1) * per_tile).min(count)
    }
}
