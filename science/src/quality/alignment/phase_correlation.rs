//! Phase correlation of two windows with different defocus.
//!
//! Defocus damps frequencies but does not change their phase, until it inverts their sign. So the phases of the
//! frequencies that both windows still contain give the shift. With the spectra `A` and `B` of the windows, frequency
//! `k` votes with
//!
//! `V_k = conj(A_k) B_k / (|A_k B_k| + WEAK mean |A B|)`,
//!
//! and the shift is the maximum of `sum Re(V_k exp(i k . x))`. It counts only if no other maximum is nearly as high and
//! most votes agree with it. The standard method (Kuglin and Hines 1975) whitens all frequencies alike; here weak ones,
//! which are noise in one of the windows, have little weight.

use std::{f32::consts::TAU, sync::Arc};

use rustfft::{Fft, FftPlanner, num_complex::Complex32};

use crate::quality::deterministic_sum;

/// What a shift must fulfil to count.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strictness {
    /// Least agreement of the votes with the shift: 0 (none) to 1 (all).
    agreement: f32,
    /// The peak must be this many times as high as any other one.
    peak_ratio: f32,
}

/// For a shift that is a measurement.
pub(super) const STRICT: Strictness = Strictness { agreement: 0.5, peak_ratio: 1.3 };
/// For a first guess, which is checked afterwards. If a quarter of a window has left it, many votes disagree.
pub(super) const GUESS: Strictness = Strictness { agreement: 0.2, peak_ratio: 1.15 };

/// Other peaks are searched outside this distance, px.
const APART: f32 = 6.0;
/// Least standard deviation of a window, grey levels.
const LEAST_CONTRAST: f32 = 1.0;
/// Frequencies weaker than about this share of the mean lose weight.
const WEAK: f32 = 0.3;
/// Frequencies used, cycles per px: lower ones contain uneven light and vignetting, higher ones noise and the
/// resampling.
const BAND: (f32, f32) = (0.04, 0.25);
/// Least amplitude of one window relative to the other, normalised to the low end of the band. Where blur leaves less,
/// its transfer function may soon change sign, and with it the phase.
const DAMPED: f32 = 0.3;
/// Both windows must have common texture up to this frequency, cycles per px: coarser shapes are shifted by the blur of
/// out-of-focus parts.
const LEAST_COMMON: f32 = 0.07;

/// Measures shifts between square windows of one size.
pub(super) struct Correlator {
    side: usize,
    strictness: Strictness,
    taper: Vec<f32>,
    /// The frequencies that vote.
    frequencies: Vec<Frequency>,
    forward: Arc<dyn Fft<f32>>,
    backward: Arc<dyn Fft<f32>>,
}

/// One frequency of a half plane.
#[derive(Clone, Copy)]
struct Frequency {
    /// Radians per px.
    u: f32,
    v: f32,
    /// Length, cycles per px.
    radius: f32,
    /// Index of this frequency and of the opposite one in a spectrum.
    at: usize,
    opposite: usize,
    /// Their indices in a spectrum with half as many frequencies in each direction.
    coarse: (usize, usize),
}

/// The cross spectrum at one frequency.
struct Vote {
    frequency: Frequency,
    cross: Complex32,
    /// Energies of the two windows.
    energies: (f32, f32),
}

impl Correlator {
    pub(super) fn new(side: usize, strictness: Strictness) -> Self {
        let hann: Vec<f32> = (0..side).map(|i| 0.5 - 0.5 * (TAU * (i as f32 + 0.5) / side as f32).cos()).collect();
        let taper = hann.iter().flat_map(|&y| hann.iter().map(move |&x| x * y)).collect();
        let mut planner = FftPlanner::new();
        let (forward, backward) = (planner.plan_fft_forward(side), planner.plan_fft_inverse(side / 2));
        Self { side, strictness, taper, frequencies: frequencies(side), forward, backward }
    }

    /// Shift of the content from window `a` to window `b`, px (x, y), from the `valid` pixels; none if the windows have
    /// no common texture.
    pub(super) fn shift(&self, a: &[f32], b: &[f32], valid: &[bool]) -> Option<(f64, f64)> {
        let (a, b) = (self.prepared(a, valid)?, self.prepared(b, valid)?);
        let both: Vec<Complex32> = a.iter().zip(&b).map(|(&re, &im)| Complex32::new(re, im)).collect();
        let (votes, mut surface) = self.cross_spectrum(both);
        let total: f32 = votes.iter().map(|vote| vote.cross.norm()).sum();
        if total <= 0.0 || !total.is_finite() {
            return None;
        }
        // inverse transform at every other pixel: the band has no finer detail. Columns are stored as rows and come
        // first.
        self.backward.process(&mut surface);
        transpose(&mut surface, self.side / 2);
        self.backward.process(&mut surface);
        let start = self.peak(&surface)?;
        let (x, y) = refine(&votes, start)?;
        let agreeing: f32 = votes
            .iter()
            .map(|vote| vote.cross.re * vote.phase(x, y).cos() - vote.cross.im * vote.phase(x, y).sin())
            .sum();
        (agreeing > self.strictness.agreement * total).then_some((f64::from(x), f64::from(y)))
    }

    /// The window without its mean, tapered to the borders, 0 where not valid; none with too little contrast.
    fn prepared(&self, window: &[f32], valid: &[bool]) -> Option<Vec<f32>> {
        let weights: Vec<f32> =
            self.taper.iter().zip(valid).map(|(&taper, &valid)| if valid { taper } else { 0.0 }).collect();
        // values that the slice does not cover are arbitrary, possibly NaN
        let mut values: Vec<f32> =
            window.iter().zip(valid).map(|(&value, &valid)| if valid { value } else { 0.0 }).collect();
        let sum = deterministic_sum::sum(&weights);
        let mean = (deterministic_sum::dot(&values, &weights) / sum) as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        let mut tapered = values.clone();
        tapered.iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight);
        let contrast = (deterministic_sum::dot(&tapered, &values) / sum).sqrt();
        (contrast.is_finite() && contrast >= f64::from(LEAST_CONTRAST)).then_some(tapered)
    }

    /// The votes of a half plane, and their spectrum over the whole plane without the upper half of the frequencies in
    /// each direction, which the band does not use. Both windows are real, so one transform of `a + i b` contains both
    /// spectra.
    fn cross_spectrum(&self, mut both: Vec<Complex32>) -> (Vec<Vote>, Vec<Complex32>) {
        self.forward.process(&mut both);
        transpose(&mut both, self.side);
        self.forward.process(&mut both);
        let vote = |&frequency: &Frequency| {
            let (here, there) = (both[frequency.at], both[frequency.opposite].conj());
            let a = (here + there) * 0.5;
            let b = (here - there) * Complex32::new(0.0, -0.5);
            Vote { frequency, cross: a.conj() * b, energies: (a.norm_sqr(), b.norm_sqr()) }
        };
        let mut votes: Vec<Vote> = self.frequencies.iter().map(vote).collect();
        let common = common_band(&votes, self.side);
        votes.retain(|vote| vote.frequency.radius <= common);
        if common < LEAST_COMMON {
            votes.clear();
        }
        whiten(&mut votes);
        let half = self.side / 2;
        let mut spectrum = vec![Complex32::default(); half * half];
        for vote in &votes {
            spectrum[vote.frequency.coarse.0] = vote.cross;
            spectrum[vote.frequency.coarse.1] = vote.cross.conj();
        }
        (votes, spectrum)
    }

    /// Position of the highest point, px; none if another maximum is nearly as high.
    fn peak(&self, surface: &[Complex32]) -> Option<(f32, f32)> {
        let side = self.side / 2;
        let highest = (0..surface.len()).max_by(|&i, &j| surface[i].re.total_cmp(&surface[j].re))?;
        let signed = |i: usize| 2.0 * if i < side / 2 { i as f32 } else { i as f32 - side as f32 };
        let place = |i: usize| (signed(i % side), signed(i / side));
        let (x, y) = place(highest);
        let away = |a: f32, b: f32| ((a - b).abs()).min(self.side as f32 - (a - b).abs());
        let mut second = 0.0f32;
        for row in 0..side {
            let down = away(place(row * side).1, y);
            for (column, value) in surface[row * side..(row + 1) * side].iter().enumerate() {
                // few values are high enough for their distance to matter
                if value.re > second && away(place(column).0, x).powi(2) + down * down > APART * APART {
                    second = value.re;
                }
            }
        }
        (surface[highest].re > self.strictness.peak_ratio * second).then_some((x, y))
    }
}

impl Vote {
    /// Phase of this frequency after a shift by (x, y), radians.
    fn phase(&self, x: f32, y: f32) -> f32 {
        self.frequency.u * x + self.frequency.v * y
    }
}

/// The frequencies of the band, each opposite pair once. Spectra are transposed: rows are horizontal frequencies.
fn frequencies(side: usize) -> Vec<Frequency> {
    let half = side / 2;
    let opposite = |i: usize| (side - i) % side;
    let cycles = |i: usize| if i <= half { i as f32 } else { i as f32 - side as f32 } / side as f32;
    // in the smaller spectrum negative frequencies start at a lower index
    let coarse = |i: usize| if i < half { i } else { i - half };
    let mut frequencies = Vec::new();
    for across in 0..=half {
        for down in 0..side {
            let (u, v) = (cycles(across), cycles(down));
            let radius = u.hypot(v);
            if !(BAND.0..BAND.1).contains(&radius) || (across == 0 && down > half) {
                continue;
            }
            let coarse_at = |across: usize, down: usize| coarse(across) * half + coarse(down);
            frequencies.push(Frequency {
                u: TAU * u,
                v: TAU * v,
                radius,
                at: across * side + down,
                opposite: opposite(across) * side + opposite(down),
                coarse: (coarse_at(across, down), coarse_at(opposite(across), opposite(down))),
            });
        }
    }
    frequencies
}

/// The highest frequency up to which neither window is damped too much relative to the other, cycles per px.
fn common_band(votes: &[Vote], side: usize) -> f32 {
    // rings of four frequencies
    let ring = |frequency: f32| ((frequency - BAND.0) * side as f32 / 4.0) as usize;
    let mut energies = vec![(0.0f32, 0.0f32); ring(BAND.1) + 1];
    for vote in votes {
        if let Some(sums) = energies.get_mut(ring(vote.frequency.radius)) {
            sums.0 += vote.energies.0;
            sums.1 += vote.energies.1;
        }
    }
    let amplitude_ratio = |&(a, b): &(f32, f32)| (a / b.max(f32::MIN_POSITIVE)).sqrt();
    let Some(first) = energies.first().map(amplitude_ratio).filter(|ratio| *ratio > 0.0) else { return 0.0 };
    let damped = |sums: &(f32, f32)| {
        let ratio = amplitude_ratio(sums) / first;
        !(DAMPED..=1.0 / DAMPED).contains(&ratio)
    };
    let rings = energies.iter().position(damped).unwrap_or(energies.len());
    (BAND.0 + rings as f32 * 4.0 / side as f32).min(BAND.1)
}

/// Whitens the votes: strong frequencies count alike, weak ones, which are noise in one of the windows, count little.
fn whiten(votes: &mut [Vote]) {
    let mean = votes.iter().map(|vote| vote.cross.norm()).sum::<f32>() / votes.len().max(1) as f32;
    if mean <= 0.0 {
        return;
    }
    for vote in votes {
        vote.cross /= vote.cross.norm() + WEAK * mean;
    }
}

/// Refines the peak to a fraction of a pixel: Newton's method on the sum of the votes. None if it leaves the peak.
fn refine(votes: &[Vote], (start_x, start_y): (f32, f32)) -> Option<(f32, f32)> {
    let (mut x, mut y) = (start_x, start_y);
    for _ in 0..12 {
        let (mut gx, mut gy, mut xx, mut xy, mut yy) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for vote in votes {
            let (sin, cos) = vote.phase(x, y).sin_cos();
            let agreeing = vote.cross.re * cos - vote.cross.im * sin;
            let turned = vote.cross.re * sin + vote.cross.im * cos;
            gx -= vote.frequency.u * turned;
            gy -= vote.frequency.v * turned;
            xx += vote.frequency.u * vote.frequency.u * agreeing;
            xy += vote.frequency.u * vote.frequency.v * agreeing;
            yy += vote.frequency.v * vote.frequency.v * agreeing;
        }
        let determinant = xx * yy - xy * xy;
        if xx <= 0.0 || determinant <= 1e-6 * xx * yy {
            return None;
        }
        let (step_x, step_y) = ((yy * gx - xy * gy) / determinant, (xx * gy - xy * gx) / determinant);
        x += step_x;
        y += step_y;
        if (x - start_x).hypot(y - start_y) > 2.5 {
            return None;
        }
        if step_x.hypot(step_y) < 1e-4 {
            break;
        }
    }
    Some((x, y))
}

fn transpose(data: &mut [Complex32], side: usize) {
    for row in 0..side {
        for column in row + 1..side {
            data.swap(row * side + column, column * side + row);
        }
    }
}
