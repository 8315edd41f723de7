//! A focus measure that is robust to noise: the local energy of the Laplacian of Gaussian,
//! `E = G(sigma_2) * (L (G(sigma_1) * I))^2`.
//!
//! The first Gaussian suppresses the highest frequencies. There noise is strongest, and resampling attenuates it
//! differently in each slice: without the Gaussian the reference slice, the only one that is not resampled, would win
//! wherever there is little texture.

use super::laplacian::{laplacian, repeat_border};
use crate::imaging::{
    Plane,
    simd::{self, Avx2},
};

/// Taps of half of the first Gaussian kernel, centre included (radius 3).
const BEFORE: usize = 4;

/// The focus energy at two given scales.
#[derive(Debug, Clone)]
pub struct FocusEnergy {
    before: [f32; BEFORE],
    after: After,
    simd: Option<Avx2>,
}

/// Half of the second Gaussian kernel.
#[derive(Debug, Clone)]
enum After {
    Near([f32; 4]),
    Wide([f32; 7]),
}

/// Buffers of [`FocusEnergy::rows`]: rows that several output rows need.
#[derive(Debug, Default)]
pub struct Rows {
    /// One row of luma, with its border repeated.
    luma: Vec<f32>,
    /// Luma smoothed along x, a ring buffer.
    across: Vec<f32>,
    /// Smoothed luma, a ring buffer of three rows.
    smooth: Vec<f32>,
    /// One row of the squared Laplacian, with its border repeated.
    squared: Vec<f32>,
    /// The same averaged along x, a ring buffer.
    averaged: Vec<f32>,
    out: Vec<f32>,
}

impl FocusEnergy {
    /// The measure of the decision map: `sigma_1` = 1 px, `sigma_2` = 2 px. Robust to noise.
    pub fn for_decision_map() -> Self {
        Self { before: half(1.0), after: After::Wide(half(2.0)), simd: Avx2::detect() }
    }

    /// The measure that localises edges: `sigma_1` = 0.7 px, `sigma_2` = 1 px.
    pub fn for_edges() -> Self {
        Self { before: half(0.7), after: After::Near(half(1.0)), simd: Avx2::detect() }
    }

    /// Radius of the support of the energy, px.
    pub fn reach(&self) -> usize {
        let after = match &self.after {
            After::Near(half) => half.len(),
            After::Wide(half) => half.len(),
        };
        BEFORE + after - 1
    }

    /// The energy of the rows `rows` of a `width` x `height` image, in squared grey levels. `luma(y, out)` fills `out`
    /// with row `y` of the luma; `emit(y, energy)` receives the rows in ascending order. Beyond the image its border is
    /// repeated. The result of a row does not depend on `rows`.
    pub fn rows(
        &self,
        size: (usize, usize),
        rows: std::ops::Range<usize>,
        buffers: &mut Rows,
        mut luma: impl FnMut(usize, &mut [f32]),
        mut emit: impl FnMut(usize, &[f32]),
    ) {
        // the work is compiled once, not for every caller: two calls per row cost nothing
        match &self.after {
            After::Near(after) => self.run(after, size, rows, buffers, &mut luma, &mut emit),
            After::Wide(after) => self.run(after, size, rows, buffers, &mut luma, &mut emit),
        }
    }

    /// The energy of a plane of luma, or of the difference of two.
    pub fn plane(&self, luma: &Plane<f32>, buffers: &mut Rows) -> Plane<f32> {
        let mut out = Plane::filled(luma.width, luma.height, 0.0);
        let size = (luma.width, luma.height);
        let row = |y: usize, row: &mut [f32]| row.copy_from_slice(luma.row(y));
        self.rows(size, 0..luma.height, buffers, row, |y, energy| out.row_mut(y).copy_from_slice(energy));
        out
    }

    fn run<const N: usize>(
        &self,
        after: &[f32; N],
        (width, height): (usize, usize),
        rows: std::ops::Range<usize>,
        buffers: &mut Rows,
        luma_of: &mut dyn FnMut(usize, &mut [f32]),
        emit: &mut dyn FnMut(usize, &[f32]),
    ) {
        if width == 0 || rows.is_empty() {
            return;
        }
        let last = height - 1;
        let (acrosses, averages) = (2 * BEFORE - 1, 2 * N - 1);
        let Rows { luma, across, smooth, squared, averaged, out } = buffers;
        luma.resize(width + 2 * (BEFORE - 1), 0.0);
        squared.resize(width + 2 * (N - 1), 0.0);
        for (ring, length) in [(&mut *across, acrosses), (smooth, 3), (averaged, averages), (out, 1)] {
            ring.resize(length * width, 0.0);
        }
        // ring buffers: row y is at index y modulo their length
        let place = |y: usize, length: usize| y % length * width..y % length * width + width;
        let reach = |d: usize| d - 1;
        let mut next_averaged = rows.start.saturating_sub(reach(N));
        let mut next_smooth = next_averaged.saturating_sub(1);
        let mut next_across = next_smooth.saturating_sub(reach(BEFORE));
        for y in rows {
            while next_averaged <= (y + reach(N)).min(last) {
                while next_smooth <= (next_averaged + 1).min(last) {
                    while next_across <= (next_smooth + reach(BEFORE)).min(last) {
                        let inner = reach(BEFORE)..reach(BEFORE) + width;
                        luma_of(next_across, &mut luma[inner.clone()]);
                        repeat_border(luma, inner);
                        let pairs = pairs::<BEFORE>(|d| &luma[reach(BEFORE).wrapping_add_signed(d)..][..width]);
                        self.gaussian(&self.before, pairs, &mut across[place(next_across, acrosses)]);
                        next_across += 1;
                    }
                    let taps = |d: isize| &across[place(next_smooth.saturating_add_signed(d).min(last), acrosses)];
                    self.gaussian(&self.before, pairs::<BEFORE>(taps), &mut smooth[place(next_smooth, 3)]);
                    next_smooth += 1;
                }
                let around = [next_averaged.saturating_sub(1), next_averaged, (next_averaged + 1).min(last)];
                let around = around.map(|y| &smooth[place(y, 3)]);
                let inner = reach(N)..reach(N) + width;
                simd::run(
                    self.simd,
                    #[inline(always)]
                    || laplacian(around, &mut squared[inner.clone()], |value| value * value),
                );
                repeat_border(squared, inner);
                let pairs = pairs::<N>(|d| &squared[reach(N).wrapping_add_signed(d)..][..width]);
                self.gaussian(after, pairs, &mut averaged[place(next_averaged, averages)]);
                next_averaged += 1;
            }
            let taps = |d: isize| &averaged[place(y.saturating_add_signed(d).min(last), averages)];
            self.gaussian(after, pairs::<N>(taps), out);
            emit(y, out);
        }
    }

    fn gaussian<const N: usize>(&self, half: &[f32; N], taps: [[&[f32]; 2]; N], out: &mut [f32]) {
        simd::run(
            self.simd,
            #[inline(always)]
            || weigh(half, taps, out),
        );
    }
}

/// Pixels whose sums are kept in registers.
const PART: usize = 16;

/// Weighted sum of pairs of rows, block by block: everything is read before anything is written, so the compiler need
/// not prove that `out` does not alias the rows.
#[inline(always)]
fn weigh<const N: usize>(half: &[f32; N], taps: [[&[f32]; 2]; N], out: &mut [f32]) {
    let (half, count) = (*half, out.len());
    if count < PART {
        for (x, out) in out.iter_mut().enumerate() {
            [*out] = weigh_part(&half, &taps, x);
        }
        return;
    }
    for x in (0..count).step_by(PART) {
        // the last block overlaps the one before: rows are often short, and single pixels are slow
        let x = x.min(count - PART);
        out[x..x + PART].copy_from_slice(&weigh_part::<N, PART>(&half, &taps, x));
    }
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn weigh_part<const N: usize, const P: usize>(half: &[f32; N], taps: &[[&[f32]; 2]; N], x: usize) -> [f32; P] {
    let middle = &taps[0][0][x..x + P];
    let mut sums = [0.0; P];
    for k in 0..P {
        sums[k] = half[0] * middle[k];
    }
    for d in 1..N {
        let (one, other) = (&taps[d][0][x..x + P], &taps[d][1][x..x + P]);
        for k in 0..P {
            sums[k] += half[d] * (one[k] + other[k]);
        }
    }
    sums
}

/// Half of a normalised Gaussian kernel.
fn half<const N: usize>(sigma: f64) -> [f32; N] {
    let half: [f64; N] = std::array::from_fn(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp());
    let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
    half.map(|weight| (weight / sum) as f32)
}

/// The rows at distance `d` on both sides, for each `d`.
fn pairs<'a, const N: usize>(taps: impl Fn(isize) -> &'a [f32]) -> [[&'a [f32]; 2]; N] {
    std::array::from_fn(|d| [taps(-(d as isize)), taps(d as isize)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speckle(x: usize, y: usize) -> f32 {
        ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32
    }

    /// The definition in f64, pixel by pixel.
    fn definition(picture: &Plane<f32>, before: f64, after: f64, radius: i64) -> Plane<f32> {
        let clamp = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
        let gaussian = |source: &Plane<f64>, sigma: f64, radius: i64| {
            let weight = |d: i64| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp();
            let sum: f64 = (-radius..=radius).map(weight).sum();
            Plane::from_fn(source.width, source.height, |x, y| {
                let mut total = 0.0;
                for dy in -radius..=radius {
                    for dx in -radius..=radius {
                        let at = (clamp(x as i64 + dx, source.width), clamp(y as i64 + dy, source.height));
                        total += weight(dx) * weight(dy) / (sum * sum) * source.at(at.0, at.1);
                    }
                }
                total
            })
        };
        let smooth = gaussian(&picture.map(f64::from), before, 3);
        let at = |x: i64, y: i64| smooth.at(clamp(x, smooth.width), clamp(y, smooth.height));
        let squared = Plane::from_fn(smooth.width, smooth.height, |x, y| {
            let (x, y) = (x as i64, y as i64);
            (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y)).powi(2)
        });
        gaussian(&squared, after, radius).map(|v| v as f32)
    }

    #[test]
    fn it_is_the_smoothed_square_of_the_laplacian_of_the_smoothed_picture() {
        let picture = Plane::from_fn(29, 23, speckle);
        for (measure, before, after, radius) in
            [(FocusEnergy::for_decision_map(), 1.0, 2.0, 6), (FocusEnergy::for_edges(), 0.7, 1.0, 3)]
        {
            let expected = definition(&picture, before, after, radius);
            let got = measure.plane(&picture, &mut Rows::default());
            for (got, expected) in got.data.iter().zip(&expected.data) {
                assert!((got - expected).abs() < 1e-3 * expected.max(1.0), "{got} instead of {expected}");
            }
        }
    }

    #[test]
    fn rows_do_not_depend_on_the_band_they_are_computed_in() {
        let picture = Plane::from_fn(40, 50, speckle);
        let measure = FocusEnergy::for_decision_map();
        let whole = measure.plane(&picture, &mut Rows::default());
        for band in [1, 7, 16] {
            let mut buffers = Rows::default();
            for start in (0..50).step_by(band) {
                let luma = |y: usize, row: &mut [f32]| row.copy_from_slice(picture.row(y));
                let rows = start..(start + band).min(50);
                measure.rows((40, 50), rows, &mut buffers, luma, |y, energy| assert_eq!(energy, whole.row(y)));
            }
        }
    }

    #[test]
    fn a_flat_picture_has_none_and_small_pictures_are_fine() {
        let flat = FocusEnergy::for_decision_map().plane(&Plane::filled(20, 20, 77.0), &mut Rows::default());
        assert!(flat.data.iter().all(|&v| v < 1e-6));
        for (width, height) in [(1, 1), (1, 7), (2, 2), (5, 1)] {
            let picture = Plane::from_fn(width, height, speckle);
            assert!(FocusEnergy::for_edges().plane(&picture, &mut Rows::default()).data.iter().all(|v| v.is_finite()));
        }
    }
}
