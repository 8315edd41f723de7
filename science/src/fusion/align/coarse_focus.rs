//! Coarse focus: the slice with the largest focus energy in wide windows around each cell of 4 x 4 px, and the noise
//! level.
//!
//! The sharpest slice at a single pixel is unreliable where there is little texture or beside a strong edge. Wide
//! windows show which slice is in focus around it; the decision map of halo-corrected fusion compares the two.
//!
//! In: rows of focus energy of each slice, in any order of slices. Out: [`CoarseFocusMaps`]. With `e` the mean energy
//! of a slice in a cell and `G` a Gaussian over cells, a scale holds per cell the slice with the largest `G * e`.

use std::sync::Mutex;

use crate::{
    fusion::{
        lock::{locked, unlocked},
        plan::UNCOVERED,
    },
    imaging::{
        Plane,
        simd::{self, Avx2},
    },
};

/// Side of a cell, px.
pub(in crate::fusion) const CELL: usize = 4;

/// Standard deviations of the Gaussians, cells: 6 px and 14 px.
const SIGMAS: [f32; 2] = [1.5, 3.5];

/// Most cells per slice from which the noise is estimated.
const MAX_SAMPLES: usize = 4096;

/// Energy, in multiples of that of noise, up to which a window has no texture: noise alone would choose its slice,
/// another one in each window.
const TEXTURELESS: f32 = 2.0;

/// Running argmax of the coarse focus over the slices.
pub(in crate::fusion) struct CoarseFocus {
    columns: usize,
    rows: usize,
    /// Every `stride`-th cell is a sample for the noise.
    stride: usize,
    scales: Vec<Mutex<RunningScale>>,
    /// Per slice: the energies of its samples.
    samples: Mutex<Vec<Vec<f32>>>,
}

/// The running argmax of one scale.
struct RunningScale {
    /// The Gaussian, from its centre on.
    half_kernel: Vec<f32>,
    best: Vec<f32>,
    slice: Vec<u16>,
}

/// The coarse focus of all slices.
pub(in crate::fusion) struct CoarseFocusMaps {
    /// The scales, narrow to wide.
    pub scales: Vec<CoarseScale>,
    /// Per cell: whether no slice has texture in any of its windows.
    pub textureless: Plane<bool>,
    /// Focus energy of noise, squared grey levels.
    pub noise: f32,
}

/// The coarse focus at one scale, per cell.
pub(in crate::fusion) struct CoarseScale {
    /// The slice with the largest mean energy; the reference slice where the window has no texture.
    pub slice: Plane<u16>,
    /// The largest mean energy, squared grey levels.
    pub energy: Plane<f32>,
}

impl CoarseFocus {
    pub(super) fn new(width: usize, height: usize, slices: usize) -> Self {
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let cells = columns * rows;
        let scale = |sigma: f32| {
            let radius = (2.5 * sigma).ceil() as usize;
            let half: Vec<f32> = (0..=radius).map(|d| (-((d * d) as f32) / (2.0 * sigma * sigma)).exp()).collect();
            let sum = half[0] + 2.0 * half[1..].iter().sum::<f32>();
            let half_kernel = half.iter().map(|weight| weight / sum).collect();
            Mutex::new(RunningScale {
                half_kernel,
                best: vec![f32::NEG_INFINITY; cells],
                slice: vec![UNCOVERED; cells],
            })
        };
        Self {
            columns,
            rows,
            stride: stride(columns, rows),
            scales: SIGMAS.into_iter().map(scale).collect(),
            samples: Mutex::new(vec![Vec::new(); slices]),
        }
    }

    /// Number of cells in `rows` rows of pixels.
    pub(super) fn cells_in_rows(&self, rows: usize) -> usize {
        rows.div_ceil(CELL) * self.columns
    }

    /// Adds the columns `columns` of a row of energies to its cells; `row` counts from the first row of `cells`.
    pub(super) fn add(&self, cells: &mut [f32], row: usize, energy: &[f32], columns: std::ops::Range<usize>) {
        let line = &mut cells[row / CELL * self.columns..][..self.columns];
        let share = 1.0 / (CELL * CELL) as f32;
        let start = columns.start.next_multiple_of(CELL).min(columns.end);
        for x in columns.start..start {
            line[x / CELL] += energy[x] * share;
        }
        let whole = energy[start..columns.end].chunks_exact(CELL);
        for (x, &rest) in whole.remainder().iter().enumerate() {
            line[(columns.end - whole.remainder().len() + x) / CELL] += rest * share;
        }
        for (cell, energies) in line[start / CELL..].iter_mut().zip(whole) {
            *cell += energies.iter().sum::<f32>() * share;
        }
    }

    /// Enters the complete cells of `slice`.
    pub(super) fn enter(&self, slice: usize, cells: Vec<f32>) {
        locked(&self.samples)[slice] = cells.iter().step_by(self.stride).copied().collect();
        for scale in &self.scales {
            let half_kernel = locked(scale).half_kernel.clone();
            let means = smoothed(&cells, self.columns, self.rows, &half_kernel);
            let mut running = locked(scale);
            let RunningScale { best, slice: sharpest, .. } = &mut *running;
            let slice = slice as u16;
            simd::run(
                Avx2::detect(),
                #[inline(always)]
                || {
                    for ((best, sharpest), &energy) in best.iter_mut().zip(sharpest).zip(&means) {
                        let wins = (energy > *best) | ((energy == *best) & (slice < *sharpest));
                        *best = if wins { energy } else { *best };
                        *sharpest = if wins { slice } else { *sharpest };
                    }
                },
            );
        }
    }

    /// The maps of all entered slices; `reference` is the slice of windows without texture.
    pub(in crate::fusion) fn finish(self, reference: usize) -> CoarseFocusMaps {
        let noise = noise(&unlocked(self.samples));
        let (width, height) = (self.columns, self.rows);
        let mut textureless = Plane::filled(width, height, true);
        let mut scales = Vec::new();
        for scale in self.scales {
            let RunningScale { best, mut slice, .. } = unlocked(scale);
            for ((slice, energy), textureless) in slice.iter_mut().zip(&best).zip(&mut textureless.data) {
                let textured = *energy > TEXTURELESS * noise;
                *textureless &= !textured;
                if !textured && *slice != UNCOVERED {
                    *slice = reference as u16;
                }
            }
            let energy = Plane { width, height, data: best };
            scales.push(CoarseScale { slice: Plane { width, height, data: slice }, energy });
        }
        CoarseFocusMaps { scales, textureless, noise }
    }
}

/// The step from sample to sample of `columns` x `rows` cells, row by row. It has no common divisor with `columns`, so
/// that the samples come from all columns.
fn stride(columns: usize, rows: usize) -> usize {
    let divisor = |mut a: usize, mut b: usize| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let mut stride = (columns * rows).div_ceil(MAX_SAMPLES).max(1);
    while divisor(stride, columns) != 1 {
        stride += 1;
    }
    stride
}

/// Focus energy of noise: the median over cells of the lower quartile over slices. In most cells most slices are out of
/// focus and show noise only.
fn noise(samples: &[Vec<f32>]) -> f32 {
    let cells = samples.iter().map(Vec::len).min().unwrap_or(0);
    let mut quartiles: Vec<f32> = (0..cells)
        .filter_map(|cell| {
            let mut energies: Vec<f32> =
                samples.iter().map(|slice| slice[cell]).filter(|&energy| energy > 0.0).collect();
            energies.sort_by(f32::total_cmp);
            energies.get(energies.len() / 4).copied()
        })
        .collect();
    quartiles.sort_by(f32::total_cmp);
    quartiles.get(quartiles.len() / 2).copied().unwrap_or(0.0)
}

/// `cells` convolved along both axes with the symmetric kernel whose half from the centre on is `half`; borders are
/// repeated.
fn smoothed(cells: &[f32], columns: usize, rows: usize, half: &[f32]) -> Vec<f32> {
    let (radius, simd) = (half.len() - 1, Avx2::detect());
    let mut across = vec![0.0f32; cells.len()];
    let mut padded = vec![0.0f32; columns + 2 * radius];
    for (row, out) in cells.chunks_exact(columns).zip(across.chunks_exact_mut(columns)) {
        padded[radius..radius + columns].copy_from_slice(row);
        padded[..radius].fill(row[0]);
        padded[radius + columns..].fill(row[columns - 1]);
        simd::run(
            simd,
            #[inline(always)]
            || weigh(half, |d| [&padded[radius - d..][..columns], &padded[radius + d..][..columns]], out),
        );
    }
    let mut out = vec![0.0f32; cells.len()];
    let row = |y: usize| &across[y * columns..(y + 1) * columns];
    for (y, out) in out.chunks_exact_mut(columns).enumerate() {
        simd::run(
            simd,
            #[inline(always)]
            || weigh(half, |d| [row(y.saturating_sub(d)), row((y + d).min(rows - 1))], out),
        );
    }
    out
}

/// Cells whose sums are kept in registers.
const PART: usize = 32;

/// Writes to `out`, which must be 0, the weighted sum of pairs of rows; `pair` gives the two at a distance from the
/// centre.
#[inline(always)]
fn weigh<'a>(half: &[f32], pair: impl Fn(usize) -> [&'a [f32]; 2], out: &mut [f32]) {
    let mut done = 0;
    for (at, out) in (0..).step_by(PART).zip(out.as_chunks_mut::<PART>().0) {
        let mut sums = [0.0f32; PART];
        for (d, &weight) in half.iter().enumerate() {
            let weight = if d == 0 { 0.5 * weight } else { weight };
            let [one, other] = pair(d).map(|row| &row[at..at + PART]);
            for k in 0..PART {
                sums[k] += weight * (one[k] + other[k]);
            }
        }
        *out = sums;
        done = at + PART;
    }
    for (x, out) in out.iter_mut().enumerate().skip(done) {
        for (d, &weight) in half.iter().enumerate() {
            let weight = if d == 0 { 0.5 * weight } else { weight };
            let [one, other] = pair(d);
            *out += weight * (one[x] + other[x]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The coarse focus of 24 x 16 px in which slice `s` has `energy(s, x)` in every row.
    fn coarse_focus(order: &[usize], energy: impl Fn(usize, usize) -> f32) -> CoarseFocusMaps {
        let coarse = CoarseFocus::new(24, 16, order.len());
        for &slice in order {
            let mut cells = vec![0.0; coarse.cells_in_rows(16)];
            let row: Vec<f32> = (0..24).map(|x| energy(slice, x)).collect();
            (0..16).for_each(|y| coarse.add(&mut cells, y, &row, 0..24));
            coarse.enter(slice, cells);
        }
        coarse.finish(0)
    }

    #[test]
    fn the_slice_with_the_sharpest_window_is_chosen_in_any_order_of_slices() {
        let energy = |slice: usize, x: usize| if (slice == 0) == (x < 12) { 9.0 } else { 1.0 };
        for order in [[0, 1], [1, 0]] {
            let maps = coarse_focus(&order, energy);
            assert_eq!(maps.scales[0].slice.row(1), [0, 0, 0, 1, 1, 1]);
        }
    }

    #[test]
    fn noise_is_the_energy_that_most_slices_show() {
        let maps = coarse_focus(&[0, 1, 2, 3], |slice, _| if slice == 2 { 50.0 } else { 2.0 });
        assert!((maps.noise - 2.0).abs() < 1e-5);
    }

    #[test]
    fn where_no_slice_has_any_energy_the_reference_slice_is_chosen() {
        let coarse = CoarseFocus::new(24, 16, 2);
        (0..2).for_each(|slice| coarse.enter(slice, vec![0.0; coarse.cells_in_rows(16)]));
        let maps = coarse.finish(1);
        assert_eq!(maps.noise, 0.0);
        assert!(maps.textureless.data.iter().all(|&textureless| textureless));
        assert!(maps.scales.iter().all(|scale| scale.slice.data.iter().all(|&slice| slice == 1)));
    }

    #[test]
    fn samples_of_the_noise_come_from_all_columns() {
        for (columns, rows) in [(1024, 1024), (1500, 1000), (1024, 683), (1000, 4), (1, 1), (1, 9000), (90, 60)] {
            let (cells, stride) = (columns * rows, stride(columns, rows));
            let mut sampled = vec![false; columns];
            (0..cells).step_by(stride).for_each(|cell| sampled[cell % columns] = true);
            assert!(sampled.iter().all(|&sampled| sampled), "{columns} x {rows} cells, every {stride}-th");
            assert!(cells.div_ceil(stride) <= MAX_SAMPLES, "{columns} x {rows} cells, every {stride}-th");
        }
    }

    #[test]
    fn uncovered_columns_add_no_energy() {
        let coarse = CoarseFocus::new(10, 4, 1);
        let mut cells = vec![0.0; coarse.cells_in_rows(4)];
        (0..4).for_each(|y| coarse.add(&mut cells, y, &[1.0; 10], 3..9));
        assert_eq!(cells, [0.25, 1.0, 0.25]);
    }
}
