//! Brightness and colour of a slice relative to the reference slice.
//!
//! The canvas is cut into square cells, and each slice keeps the mean of every cell. Two slices are compared by the
//! median ratio over the cells that both cover, which neither defocus nor a few changed cells can move.

use crate::{
    imaging::{Coverage, LUMA, Rect, Sample, statistics},
    quality::clipping::FULL,
};

/// Cells over the canvas, about: cells are large compared with any blur and small compared with uneven light.
const CELLS: usize = 768;
/// Least side of a cell, px.
const LEAST_SIDE: usize = 16;
/// About this many rows of a large cell are read.
const ROWS: usize = 10;
/// Darker cells (0..255) are skipped: noise and the black level outweigh the light there.
const LEAST_MEAN: f32 = 4.0;
/// With fewer common cells nothing is said about the light of two slices, and what they show.
const LEAST_COMMON: usize = 24;
/// Cells with a larger share of clipped samples are skipped.
const MOST_CLIPPED: f32 = 0.01;

/// Mean brightness before the gain, per cell: luma, red, green, blue. NaN where the slice does not cover the whole
/// cell, or the cell is too dark or clipped.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Brightness {
    means: Vec<[f32; 4]>,
}

/// The cells of a canvas, from the top left. What is left over at the right and at the bottom is in no cell.
#[derive(Debug, Clone, Copy)]
pub struct Cells {
    side: usize,
    columns: usize,
    rows: usize,
}

impl Cells {
    /// The cells of a canvas of `width` x `height` px.
    pub fn of(width: usize, height: usize) -> Self {
        let side = ((width * height / CELLS) as f64).sqrt() as usize;
        let side = side.max(LEAST_SIDE).min(width.min(height)).max(1);
        Self { side, columns: width / side, rows: height / side }
    }

    /// Distance of the rows that are read, px.
    fn step(self) -> usize {
        (self.side / ROWS).max(1)
    }
}

/// Sums over the parts of a row of pixels that are in the cells.
#[derive(Debug, Clone)]
pub(super) struct RowSums {
    /// The row of cells.
    row: usize,
    /// Per cell: the sums of [`row_sums`].
    cells: Vec<([u32; 3], u32)>,
}

impl RowSums {
    /// The sums of row `y` of a warped slice, whose samples are `samples` after the gain; none for a row that is not
    /// read.
    pub(super) fn of<S: Sample>(cells: Cells, y: usize, samples: &[S], channels: usize, gain: f64) -> Option<Self> {
        let row = y / cells.side;
        if row >= cells.rows || !(y % cells.side).is_multiple_of(cells.step()) {
            return None;
        }
        let scale = S::DEPTH.max() / 255.0;
        let full = (FULL * scale).min(FULL * scale * gain as f32) as u32;
        let parts = samples.chunks_exact(cells.side * channels).take(cells.columns);
        Some(Self { row, cells: parts.map(|part| row_sums(part, channels, full)).collect() })
    }
}

impl Brightness {
    /// The brightness of a slice from the sums of its rows, in any order. `max` is the largest sample value.
    pub(super) fn of(
        cells: Cells,
        rows: &[RowSums],
        coverage: &Coverage,
        channels: usize,
        max: f32,
        gain: f64,
    ) -> Self {
        let mut means = Vec::with_capacity(cells.rows * cells.columns);
        for row in 0..cells.rows {
            let of_row: Vec<&RowSums> = rows.iter().filter(|sums| sums.row == row).collect();
            for column in 0..cells.columns {
                let side = cells.side;
                let cell = Rect { x: column * side, y: row * side, width: side, height: side };
                let known = coverage.contains(cell) && !of_row.is_empty();
                let sums = of_row.iter().map(|row| row.cells[column]);
                means.push(if known { mean(sums, side, channels, max / 255.0, gain) } else { [f32::NAN; 4] });
            }
        }
        Self { means }
    }

    /// Median ratio of luma over the common cells; none without common cells.
    pub(crate) fn exposure_ratio(&self, reference: &Self) -> Option<f64> {
        self.median(reference, |mine, its| mine[0] / its[0])
    }

    /// Median ratio of a channel (0: luma, 1 to 3: red, green, blue) over the common cells that are not dark in it.
    /// None with too few of them: it would be the ratio of their content.
    pub(crate) fn channel_ratio(&self, reference: &Self, channel: usize) -> Option<f64> {
        let mut ratios = self.ratios(reference, |mine, its| {
            let is_lit = mine[channel].min(its[channel]) >= LEAST_MEAN;
            if is_lit { mine[channel] / its[channel] } else { f32::NAN }
        });
        let are_enough = ratios.len() >= LEAST_COMMON;
        are_enough.then(|| statistics::quantile_interpolated(&mut ratios, 0.5).map(f64::from)).flatten()
    }

    /// Median ratios of red over green and of blue over green, over the common cells.
    pub(crate) fn balance_ratio(&self, reference: &Self) -> Option<[f64; 2]> {
        let over_green = |channel: usize| {
            self.median(reference, move |mine, its| (mine[channel] / its[channel]) / (mine[2] / its[2]))
        };
        Some([over_green(1)?, over_green(3)?])
    }

    /// How much the ratio of luma varies over the common cells: half the range without the outermost 2 % on either
    /// side, natural logarithm; none with too few common cells. Neither light nor, much, defocus affects it. An object
    /// may fill few of the cells.
    pub(crate) fn variation(&self, other: &Self) -> Option<f64> {
        let mut ratios = self.ratios(other, |mine, its| (mine[0] / its[0]).ln());
        if ratios.len() < LEAST_COMMON {
            return None;
        }
        let [low, high] = [0.02, 0.98].map(|q| statistics::quantile_interpolated(&mut ratios, q));
        Some(f64::from((high? - low?) / 2.0))
    }

    fn median(&self, reference: &Self, ratio: impl Fn(&[f32; 4], &[f32; 4]) -> f32) -> Option<f64> {
        statistics::quantile_interpolated(&mut self.ratios(reference, ratio), 0.5).map(f64::from)
    }

    /// A ratio in each common cell where it is finite.
    fn ratios(&self, reference: &Self, ratio: impl Fn(&[f32; 4], &[f32; 4]) -> f32) -> Vec<f32> {
        if self.means.len() != reference.means.len() {
            return Vec::new();
        }
        let pairs = self.means.iter().zip(&reference.means);
        pairs.map(|(mine, its)| ratio(mine, its)).filter(|ratio| ratio.is_finite()).collect()
    }
}

/// The mean of a cell from the sums of the rows that were read, each `width` px long.
fn mean(
    of_rows: impl Iterator<Item = ([u32; 3], u32)>,
    width: usize,
    channels: usize,
    scale: f32,
    gain: f64,
) -> [f32; 4] {
    let (mut sums, mut clipped, mut rows) = ([0u64; 3], 0, 0);
    for (of_row, clipped_here) in of_rows {
        sums.iter_mut().zip(of_row).for_each(|(sum, more)| *sum += u64::from(more));
        clipped += clipped_here;
        rows += 1;
    }
    let samples = (rows * width) as f32;
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
