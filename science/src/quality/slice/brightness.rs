//! Brightness and colour of a slice relative to the reference slice.
//!
//! The canvas is cut into square cells, and each slice keeps the mean of every cell. Two slices are compared by the
//! median ratio over the cells that both cover, which neither defocus nor a few changed cells can move.

use super::WarpedSlice;
use crate::{
    imaging::{LUMA, Rect, Sample, statistics},
    quality::FULL,
};

/// Cells over the canvas, about: cells are large compared with any blur and small compared with uneven light.
const CELLS: usize = 768;
/// Least side of a cell, px.
const LEAST_SIDE: usize = 16;
/// About this many rows of a large cell are read.
const ROWS: usize = 10;
/// Darker cells (0..255) are skipped: noise and the black level outweigh the light there.
const LEAST_MEAN: f32 = 4.0;
/// Cells with a larger share of clipped samples are skipped.
const MOST_CLIPPED: f32 = 0.01;

/// Mean brightness before the gain, per cell: luma, red, green, blue. NaN where the slice does not cover the whole
/// cell, or the cell is too dark or clipped.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Brightness {
    means: Vec<[f32; 4]>,
}

impl Brightness {
    pub(super) fn of<S: Sample>(slice: &WarpedSlice<'_, S>, gain: f64) -> Self {
        let (width, height) = (slice.coverage.width(), slice.coverage.height());
        let side = ((width * height / CELLS) as f64).sqrt() as usize;
        let side = side.max(LEAST_SIDE).min(width.min(height)).max(1);
        let cells = (0..height / side)
            .flat_map(|y| (0..width / side).map(move |x| Rect { x: x * side, y: y * side, width: side, height: side }));
        let mean = |cell: Rect| if slice.coverage.contains(cell) { mean(slice, gain, cell) } else { [f32::NAN; 4] };
        Self { means: cells.map(mean).collect() }
    }

    /// Median ratio of luma over the common cells; none without common cells.
    pub(crate) fn exposure_ratio(&self, reference: &Self) -> Option<f64> {
        self.median(reference, |mine, its| mine[0] / its[0])
    }

    /// Median ratios of red over green and of blue over green, over the common cells.
    pub(crate) fn balance_ratio(&self, reference: &Self) -> Option<[f64; 2]> {
        let over_green = |channel: usize| {
            self.median(reference, move |mine, its| (mine[channel] / its[channel]) / (mine[2] / its[2]))
        };
        Some([over_green(1)?, over_green(3)?])
    }

    fn median(&self, reference: &Self, ratio: impl Fn(&[f32; 4], &[f32; 4]) -> f32) -> Option<f64> {
        if self.means.len() != reference.means.len() {
            return None;
        }
        let pairs = self.means.iter().zip(&reference.means);
        let mut ratios: Vec<f32> =
            pairs.map(|(mine, its)| ratio(mine, its)).filter(|ratio| ratio.is_finite()).collect();
        statistics::quantile_interpolated(&mut ratios, 0.5).map(f64::from)
    }
}

fn mean<S: Sample>(slice: &WarpedSlice<'_, S>, gain: f64, cell: Rect) -> [f32; 4] {
    let (width, channels) = (slice.coverage.width(), slice.channels);
    let scale = S::DEPTH.max() / 255.0;
    let full = (FULL * scale).min(FULL * scale * gain as f32) as u32;
    let step = (cell.height / ROWS).max(1);
    let (mut sums, mut clipped, mut rows) = ([0u64; 3], 0, 0);
    for y in (cell.y..cell.y + cell.height).step_by(step) {
        let row = &slice.samples[(y * width + cell.x) * channels..(y * width + cell.x + cell.width) * channels];
        let (of_row, clipped_here) = row_sums(row, channels, full);
        sums.iter_mut().zip(of_row).for_each(|(sum, more)| *sum += u64::from(more));
        clipped += clipped_here;
        rows += 1;
    }
    let samples = (rows * cell.width) as f32;
    let unit = 1.0 / (samples * scale * gain as f32);
    let [red, green, blue] = sums.map(|sum| sum as f32 * unit);
    let luma = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue;
    if clipped as f32 > MOST_CLIPPED * samples * channels as f32 || luma < LEAST_MEAN {
        return [f32::NAN; 4];
    }
    [luma, red, green, blue]
}

/// Independent sums, for vector instructions: a multiple of 1 and of 3 channels and of a vector's length.
const LANES: usize = 24;

/// Sum per channel (for grey samples three times the same), and the number of samples at or above `full`.
fn row_sums<S: Sample>(row: &[S], channels: usize, full: u32) -> ([u32; 3], u32) {
    let (mut sums, mut clipped) = ([0u32; LANES], [0u32; LANES]);
    let chunks = row.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for ((sum, clipped), sample) in sums.iter_mut().zip(&mut clipped).zip(chunk) {
            *sum += sample.integer();
            *clipped += u32::from(sample.integer() >= full);
        }
    }
    for ((sum, clipped), sample) in sums.iter_mut().zip(&mut clipped).zip(rest) {
        *sum += sample.integer();
        *clipped += u32::from(sample.integer() >= full);
    }
    let of_channel = |channel: usize| match channels {
        1 => sums.iter().sum(),
        _ => sums.iter().skip(channel).step_by(3).sum(),
    };
    ([0, 1, 2].map(of_channel), clipped.iter().sum())
}
