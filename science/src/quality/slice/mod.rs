//! Measurements of single slices, taken while a slice is warped: sharpness, clipping, coverage, brightness, a
//! fingerprint that reveals duplicates, and the focus measure at the sample points.

mod brightness;
mod fingerprint;

use std::ops::Range;

use super::{
    clipping::{FULL, ZERO},
    deterministic_sum,
    sampling::{Blocks, Points},
    score::sobel,
};
use crate::{
    imaging::{Coverage, Plane, Rect, Sample, grey},
    types::Error,
};

use brightness::RowSums;

pub use brightness::{Brightness, Cells};
pub use fingerprint::Fingerprint;

/// Measures the slices of one stack, one at a time, in any order and from any thread.
#[derive(Debug, Clone)]
pub struct SliceMeter<'a> {
    width: usize,
    height: usize,
    reference: usize,
    object: Option<&'a Plane<u8>>,
    blocks: Blocks,
    points: Points,
}

/// What the meter takes from the rows of a slice while it is warped.
#[derive(Debug, Clone, Default)]
pub struct RowMeasurements {
    saliency: Vec<f32>,
    brightness: Vec<RowSums>,
}

impl RowMeasurements {
    /// Takes the row `y` of samples of a warped slice, after the gain `gain`.
    pub fn take_samples<S: Sample>(&mut self, cells: Cells, y: usize, row: &[S], channels: usize, gain: f64) {
        self.brightness.extend(RowSums::of(cells, y, row, channels, usable(gain)));
    }

    /// The brightness of a slice of which all rows of samples (of `S`, with `channels` channels) were taken.
    pub fn brightness<S: Sample>(&self, cells: Cells, coverage: &Coverage, channels: usize, gain: f64) -> Brightness {
        Brightness::of(cells, &self.brightness, coverage, channels, S::DEPTH.max(), usable(gain))
    }

    /// Takes the row `y` of the focus measure, which is valid in `known` columns. Call it in ascending order of rows.
    pub fn take_saliency(&mut self, meter: &SliceMeter<'_>, y: usize, values: &[f32], known: &Range<usize>) {
        meter.points.pick(y, values, known, &mut self.saliency);
    }

    /// The measurements of bands of rows, which are given from the top to the bottom.
    pub fn join(bands: Vec<Self>) -> Self {
        let mut all = Self::default();
        for band in bands {
            all.saliency.extend(band.saliency);
            all.brightness.extend(band.brightness);
        }
        all
    }
}

/// The interleaved samples of a rectangle of the canvas.
pub type ReadSamples<'a, S> = dyn Fn(Rect) -> Result<Vec<S>, Error> + Sync + 'a;

/// A slice after resampling to the canvas of the reference slice.
#[derive(Clone, Copy)]
pub struct WarpedSlice<'a, S> {
    /// Reads the samples after the gain.
    pub samples: &'a ReadSamples<'a, S>,
    /// Channels: 1 or 3.
    pub channels: usize,
    /// The pixels of the canvas that the slice covers.
    pub coverage: &'a Coverage,
    /// The gain that was applied to the samples.
    pub gain: f64,
}

/// The measurements of one slice.
#[derive(Debug, Clone, PartialEq)]
pub struct SliceMeasurements {
    pub(super) index: usize,
    pub(super) reference: usize,
    /// Mean squared Sobel gradient.
    pub(super) tenengrad: Option<f64>,
    /// Share of the covered pixels that are clipped.
    pub(super) clipped: Option<f64>,
    /// Share of the canvas that the slice covers.
    pub(super) covered: Option<f64>,
    pub(super) gain: f64,
    pub(super) brightness: Brightness,
    /// Fingerprint of the slice before warping.
    pub(super) fingerprint: Fingerprint,
    /// Focus measure at the sample points; NaN where the slice does not cover.
    pub(super) saliency: Vec<f32>,
}

/// Sums over the pixels of a block.
#[derive(Debug, Clone, Copy, Default)]
struct BlockSums {
    /// Squared Sobel gradients, and the number of pixels that have one.
    gradients: f64,
    inner: f64,
    /// Clipped pixels, and all pixels.
    clipped: f64,
    pixels: f64,
}

impl<'a> SliceMeter<'a> {
    /// A meter for `slices` warped slices on a canvas of `width` x `height` px. Exposures are relative to slice
    /// `reference` (clamped to the last slice). `object` (255 inside, 0 outside) restricts all measurements but
    /// brightness and coverage to the object; a plane of another size is ignored.
    pub fn new(width: usize, height: usize, slices: usize, reference: usize, object: Option<&'a Plane<u8>>) -> Self {
        let object = object.filter(|object| object.width == width && object.height == height);
        let (blocks, points) = (Blocks::of(width, height, object), Points::of(width, height, object));
        Self { width, height, reference: reference.min(slices.saturating_sub(1)), object, blocks, points }
    }

    /// The points at which the focus measure of every slice is kept: see [`Points::pick`].
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// Width and height of the canvas, px.
    pub(super) fn canvas(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Whether an object mask restricts the measurements.
    pub fn is_masked(&self) -> bool {
        self.object.is_some()
    }

    /// The blocks in which the fused image is scored.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Measures warped slice `index`. `rows` is what was taken from all of its rows, `brightness` follows from it, and
    /// `fingerprint` is that of the slice before warping. A slice that does not fit the canvas gives no numbers.
    ///
    /// # Errors
    /// The error of reading the samples.
    pub fn measure<S: Sample>(
        &self,
        index: usize,
        slice: &WarpedSlice<'_, S>,
        rows: RowMeasurements,
        brightness: Brightness,
        fingerprint: Fingerprint,
    ) -> Result<SliceMeasurements, Error> {
        let gain = usable(slice.gain);
        let size = (slice.coverage.width(), slice.coverage.height());
        let saliency = rows.saliency;
        let fits = size == (self.width, self.height) && saliency.len() == self.points.count();
        let mut measured = SliceMeasurements {
            index,
            reference: self.reference,
            tenengrad: None,
            clipped: None,
            covered: None,
            gain,
            brightness,
            fingerprint,
            saliency,
        };
        if !fits {
            measured.saliency = vec![f32::NAN; self.points.count()];
            return Ok(measured);
        }
        measured.covered = ratio(slice.coverage.pixels() as f64, (self.width * self.height) as f64);
        // pixels whose eight neighbours are covered too
        let inner = slice.coverage.eroded(1);
        let mut sums = BlockSums::default();
        for rect in &self.blocks.rects {
            let block = self.block(slice, &inner, gain as f32, *rect)?;
            sums.gradients += block.gradients;
            sums.inner += block.inner;
            sums.clipped += block.clipped;
            sums.pixels += block.pixels;
        }
        measured.tenengrad = ratio(sums.gradients, sums.inner);
        measured.clipped = ratio(sums.clipped, sums.pixels);
        Ok(measured)
    }

    fn block<S: Sample>(
        &self,
        slice: &WarpedSlice<'_, S>,
        inner: &Coverage,
        gain: f32,
        rect: Rect,
    ) -> Result<BlockSums, Error> {
        let mut sums = BlockSums::default();
        if slice.coverage.misses(rect) {
            return Ok(sums);
        }
        let mut luma = Plane::filled(rect.width, rect.height, 0.0f32);
        grey::luma_row(&(slice.samples)(rect)?, slice.channels, &mut luma.data);
        let whole = self.object.is_none() && slice.coverage.contains(rect);
        let (mut values, mut weights) = (vec![0.0f32; rect.width], vec![1.0f32; rect.width]);
        let weigh = |coverage: &Coverage, y: usize, weights: &mut [f32]| {
            let span = coverage.span(rect.y + y);
            let object = self.object.map(|object| &object.row(rect.y + y)[rect.x..rect.x + rect.width]);
            for (x, weight) in weights.iter_mut().enumerate() {
                let counts = span.contains(&(rect.x + x)) && object.is_none_or(|object| object[x] != 0);
                *weight = if counts { 1.0 } else { 0.0 };
            }
        };
        // a sample may have been clipped in the file, before the gain, or by the gain
        let full = FULL.min(FULL * gain);
        for y in 0..rect.height {
            if !whole {
                weigh(slice.coverage, y, &mut weights);
            }
            for (value, &luma) in values.iter_mut().zip(luma.row(y)) {
                *value = if (ZERO..full).contains(&luma) { 0.0 } else { 1.0 };
            }
            sums.clipped += deterministic_sum::dot(&values, &weights);
            sums.pixels += deterministic_sum::sum(&weights);
        }
        let Some(across) = rect.width.checked_sub(2) else { return Ok(sums) };
        for y in 1..rect.height.saturating_sub(1) {
            if !whole {
                weigh(inner, y, &mut weights);
            }
            let [upper, middle, lower] = [luma.row(y - 1), luma.row(y), luma.row(y + 1)];
            for (x, value) in values[..across].iter_mut().enumerate() {
                let (gx, gy) = sobel(upper, middle, lower, x);
                *value = gx * gx + gy * gy;
            }
            sums.gradients += deterministic_sum::dot(&values[..across], &weights[1..=across]);
            sums.inner += deterministic_sum::sum(&weights[1..=across]);
        }
        Ok(sums)
    }
}

/// The gain, or 1 in place of an invalid one, which would make every brightness invalid.
fn usable(gain: f64) -> f64 {
    if gain.is_finite() && gain > 0.0 { gain } else { 1.0 }
}

fn ratio(part: f64, whole: f64) -> Option<f64> {
    (whole > 0.0).then(|| part / whole).filter(|ratio| ratio.is_finite())
}

#[cfg(test)]
mod tests;
