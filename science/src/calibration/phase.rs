//! Sub-pixel positions of dots from the phase of the grid's first harmonic (quadrature demodulation at the grid
//! frequency).
//!
//! Input: a plane and, per dot, a window: its expected centre and the two grid steps there. Output: the complex
//! amplitude of the first harmonic along each step, whose phase gives the distance of the dot from its expected centre,
//! and the mean over the window.
//!
//! The window weight is `w(a, b) = (1 - |a|) (1 - |b|)` for |a|, |b| < 1, with (a, b) the position in grid steps from
//! the centre. Why the phase, and not a fit of the single dot:
//!
//! - The spectrum of `w` has double zeros at all non-zero integer grid frequencies. The mean level, its slope
//!   (vignetting) and the other harmonics do not leak into the phase.
//! - Symmetric blur changes the amplitude and not the phase, however much neighbouring dots overlap. Beyond a blur
//!   radius of 0.61 of the pitch the amplitude is negative (the dots are inverted), and the phase is as accurate as
//!   before.
//! - The measurement is linear in the image: two rounds are enough. Fitting overlapping dots one by one converges
//!   slowly, and hardly at all for a shift that all dots share.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::imaging::Plane;

/// Where the phase of the pattern is measured, in px of the plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Expected centre of the dot.
    pub at: [f64; 2],
    /// The two grid steps there.
    pub steps: [[f64; 2]; 2],
}

/// The pattern in one window.
#[derive(Debug, Clone, Copy)]
pub(super) struct PhaseMeasurement {
    /// First harmonic along each grid step.
    pub harmonics: [Harmonic; 2],
    /// Mean over the window. The window spans whole periods, so the pattern does not contribute.
    pub mean: f64,
}

/// The first harmonic of the pattern along one grid step, relative to the centre of the window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Harmonic {
    /// In-phase component: positive for a dot at the centre.
    pub cosine: f64,
    /// Quadrature component: a quarter of a step behind.
    pub sine: f64,
}

impl Harmonic {
    /// Signed amplitude for dots of polarity `sign` (1: as printed; -1: inverted by blur): negative when the dots have
    /// the other polarity.
    pub(super) fn amplitude(&self, sign: f64) -> f64 {
        self.cosine.hypot(self.sine) * (sign * self.cosine).signum()
    }

    /// Distance of the dot from the centre of the window along the step, in steps, for dots of polarity `sign`.
    pub(super) fn shift(&self, sign: f64) -> f64 {
        (sign * self.sine).atan2(sign * self.cosine) / TAU
    }
}

/// Variance of the mean over many neighbouring windows, over the variance for as many independent ones: the windows
/// overlap. For white noise it is the sum over the grid of the windows' correlations, `1 / integral(w^2)` = (3/2)^2.
pub(super) const WINDOW_OVERLAP: f64 = 2.25;

/// Standard deviation of [`Harmonic::shift`] in steps, for white noise with standard deviation `noise` per sample.
pub(super) fn shift_sigma(noise: f64, amplitude: f64, steps: [[f64; 2]; 2]) -> f64 {
    let area = (steps[0][0] * steps[1][1] - steps[0][1] * steps[1][0]).abs().max(1.0);
    noise * (2.0 / (WINDOW_OVERLAP * area)).sqrt() / (TAU * amplitude.abs().max(1e-9))
}

/// Largest weighted share of a window that may be invalid.
const MAX_INVALID: f64 = 0.1;

/// Measures all windows. `None` for a window that leaves the plane, has too many samples that are 0 in `valid`, or is
/// degenerate.
pub(super) fn measure(
    plane: &Plane<f32>,
    valid: Option<&Plane<u8>>,
    windows: &[Window],
) -> Vec<Option<PhaseMeasurement>> {
    windows.par_iter().map(|window| measure_one(plane, valid, window)).collect()
}

/// True when the window lies within a plane of `width` x `height`.
pub(super) fn inside(window: &Window, width: usize, height: usize) -> bool {
    let reach = reach(window);
    let fits = |v: f64, reach: f64, size: usize| v - reach >= 0.0 && v + reach <= size as f64 - 1.0;
    fits(window.at[0], reach[0], width) && fits(window.at[1], reach[1], height)
}

/// Half the extent of the window along x and y, px.
fn reach(window: &Window) -> [f64; 2] {
    [0, 1].map(|axis: usize| window.steps[0][axis].abs() + window.steps[1][axis].abs())
}

fn measure_one(plane: &Plane<f32>, valid: Option<&Plane<u8>>, window: &Window) -> Option<PhaseMeasurement> {
    let [u, v] = window.steps;
    let determinant = u[0] * v[1] - u[1] * v[0];
    if !inside(window, plane.width, plane.height) || determinant.abs() < 4.0 {
        return None;
    }
    // position in steps = matrix * (pixel - centre)
    let along = [v[1] / determinant, -u[1] / determinant];
    let across = [-v[0] / determinant, u[0] / determinant];
    let reach = reach(window);
    let rows = (window.at[1] - reach[1]).ceil() as usize..=(window.at[1] + reach[1]).floor() as usize;
    let turn = along.map(|per_px| (TAU * per_px).sin_cos());
    let mut sums = Sums::default();
    let mut invalid = 0.0;
    for y in rows {
        let dy = y as f64 - window.at[1];
        let Some((first, last)) = columns(window, along, [across[0] * dy, across[1] * dy], plane.width) else {
            continue;
        };
        let dx = first as f64 - window.at[0];
        let mut at = [along[0] * dx + across[0] * dy, along[1] * dx + across[1] * dy];
        // the sine and cosine advance from pixel to pixel by a rotation
        let mut waves = at.map(|t| (TAU * t).sin_cos());
        let row = &plane.row(y)[first..=last];
        for (x, &value) in (first..).zip(row) {
            let weight = (1.0 - at[0].abs()).max(0.0) * (1.0 - at[1].abs()).max(0.0);
            if valid.is_some_and(|valid| valid.at(x, y) == 0) {
                invalid += weight;
            }
            sums.add(weight, f64::from(value), &waves);
            for k in 0..2 {
                let ((s, c), (ts, tc)) = (waves[k], turn[k]);
                waves[k] = (s * tc + c * ts, c * tc - s * ts);
                at[k] += along[k];
            }
        }
    }
    // dust specks were inpainted; with more inpainted samples than this the window is unreliable
    if invalid > MAX_INVALID * sums.weight {
        return None;
    }
    sums.measurement()
}

/// The columns of one row that the window covers: both |position in steps| < 1. `shift` is the position at the column
/// of the window's centre.
fn columns(window: &Window, along: [f64; 2], shift: [f64; 2], width: usize) -> Option<(usize, usize)> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..2 {
        if along[k].abs() < 1e-12 {
            if shift[k].abs() >= 1.0 {
                return None;
            }
            continue;
        }
        let ends = [(-1.0 - shift[k]) / along[k], (1.0 - shift[k]) / along[k]];
        low = low.max(ends[0].min(ends[1]));
        high = high.min(ends[0].max(ends[1]));
    }
    let first = (window.at[0] + low).ceil().max(0.0);
    let last = (window.at[0] + high).floor().min(width as f64 - 1.0);
    (first <= last).then_some((first as usize, last as usize))
}

/// Weighted sums over one window.
#[derive(Default)]
struct Sums {
    weight: f64,
    value: f64,
    wave: [[f64; 2]; 2],
    with_value: [[f64; 2]; 2],
}

impl Sums {
    #[inline]
    fn add(&mut self, weight: f64, value: f64, waves: &[(f64, f64); 2]) {
        let weighted = weight * value;
        self.weight += weight;
        self.value += weighted;
        for ((sine, cosine), (wave, with_value)) in waves.iter().zip(self.wave.iter_mut().zip(&mut self.with_value)) {
            wave[0] += weight * cosine;
            wave[1] += weight * sine;
            with_value[0] += weighted * cosine;
            with_value[1] += weighted * sine;
        }
    }

    fn measurement(&self) -> Option<PhaseMeasurement> {
        if self.weight <= 0.0 {
            return None;
        }
        let mean = self.value / self.weight;
        // the mean contributes nothing except through the sampling of the window, which matters where the harmonic is
        // weak
        let part = |k: usize, n: usize| 2.0 * (self.with_value[k][n] - mean * self.wave[k][n]) / self.weight;
        Some(PhaseMeasurement { harmonics: [0, 1].map(|k| Harmonic { cosine: part(k, 0), sine: part(k, 1) }), mean })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rotated grid of soft dots under light that falls off to one side.
    fn picture(pitch: f64, turn: f64, origin: [f64; 2], sign: f64) -> (Plane<f32>, [[f64; 2]; 2]) {
        let steps = [[pitch * turn.cos(), pitch * turn.sin()], [-pitch * turn.sin(), pitch * turn.cos()]];
        let plane = Plane::from_fn(160, 120, |x, y| {
            let (dx, dy) = (x as f64 - origin[0], y as f64 - origin[1]);
            let u = (dx * turn.cos() + dy * turn.sin()) / pitch;
            let v = (-dx * turn.sin() + dy * turn.cos()) / pitch;
            let light = 1.0 + 0.002 * x as f64 - 0.001 * y as f64;
            let harmonics =
                0.2 * ((TAU * u).cos() + (TAU * v).cos()) + 0.1 * (TAU * (u + v)).cos() + 0.05 * (2.0 * TAU * u).cos();
            (light * (0.5 + sign * harmonics)) as f32
        });
        (plane, steps)
    }

    #[test]
    fn a_dot_is_located_to_a_thousandth_of_the_pitch_for_any_rotation_and_vignetting() {
        for (turn, sign) in [(0.0, 1.0), (0.4, 1.0), (0.785, 1.0), (0.012, -1.0)] {
            let origin = [80.37, 59.81];
            let (plane, steps) = picture(17.3, turn, origin, sign);
            let mut at = [81.9, 58.4];
            for _ in 0..3 {
                let measured = measure(&plane, None, &[Window { at, steps }])[0].expect("inside");
                let shifts = measured.harmonics.map(|h| h.shift(sign));
                at = [0, 1].map(|a| at[a] + shifts[0] * steps[0][a] + shifts[1] * steps[1][a]);
                assert!(
                    (measured.harmonics[0].amplitude(sign) - 0.2 * 1.1).abs() < 0.03,
                    "{:?}",
                    measured.harmonics[0]
                );
            }
            let error = (at[0] - origin[0]).hypot(at[1] - origin[1]);
            assert!(error < 0.017, "turned by {turn}: off by {error} px");
        }
    }

    #[test]
    fn the_mean_of_a_window_excludes_the_pattern() {
        let (plane, steps) = picture(16.0, 0.0, [80.0, 60.0], 1.0);
        for at in [[80.0, 60.0], [85.0, 52.0]] {
            let measured = measure(&plane, None, &[Window { at, steps }])[0].expect("inside");
            let light = 0.5 * (1.0 + 0.002 * at[0] - 0.001 * at[1]);
            assert!((measured.mean - light).abs() < 0.004, "{} for {light}", measured.mean);
        }
    }

    #[test]
    fn a_window_outside_the_plane_or_with_invalid_samples_is_not_measured() {
        let (plane, steps) = picture(16.0, 0.0, [80.0, 60.0], 1.0);
        assert!(measure(&plane, None, &[Window { at: [15.0, 60.0], steps }])[0].is_none());
        let covered = Plane::from_fn(160, 120, |x, y| u8::from(!(74..82).contains(&x) || !(56..64).contains(&y)));
        assert!(measure(&plane, Some(&covered), &[Window { at: [80.0, 60.0], steps }])[0].is_none());
        assert!(measure(&plane, None, &[Window { at: [80.0, 60.0], steps: [[1.0, 0.0], [1.0, 0.0]] }])[0].is_none());
    }

    #[test]
    fn the_estimated_sigma_matches_the_scatter() {
        let (clean, steps) = picture(16.0, 0.1, [80.3, 60.2], 1.0);
        let mut state = 7_u64;
        let mut normal = || {
            let mut unit = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            (-2.0 * unit().max(1e-12).ln()).sqrt() * (TAU * unit()).cos()
        };
        let window = Window { at: [80.3, 60.2], steps };
        let truth = measure(&clean, None, &[window])[0].expect("inside").harmonics[0].shift(1.0);
        let mut square = 0.0;
        for _ in 0..200 {
            let noisy = clean.map(|v| v + 0.05 * normal() as f32);
            square += (measure(&noisy, None, &[window])[0].expect("inside").harmonics[0].shift(1.0) - truth).powi(2);
        }
        let ratio = (square / 200.0).sqrt() / shift_sigma(0.05, 0.2, steps);
        assert!((0.75..1.3).contains(&ratio), "{ratio}");
    }
}
