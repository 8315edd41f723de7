//! The illumination of the back light: a smooth surface fitted to the background, by which the picture is made even.
//!
//! The surface is a polynomial of second degree in x and y. It is fitted by iteratively reweighted least squares:
//!
//! 1. The first background is what Otsu's threshold calls bright.
//! 2. Background in later rounds is what lies above `o + 0.55 (L - o)`, with `L` the surface and `o` the darkest
//!    values, which are the object. So a corner as dark as a half covered pixel elsewhere becomes background too.
//! 3. Weights suppress what lies off the surface (dust, wings): in the first rounds only what is darker, by
//!    `1 / (1 + (d / 0.1)^2)` with `d` the relative deviation; then on both sides, by Tukey's biweight.
//!
//! Outside the range that the surface has on the background it is clamped: nothing is extrapolated.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::otsu::Histogram;
use crate::imaging::statistics::quantile_floor;

/// Approximate number of pixels that are sampled, on a regular grid.
const SAMPLES: usize = 40_000;
/// Least number of background samples for a fit, and their least share of all samples.
const MIN_SAMPLES: usize = 60;
const MIN_SHARE: f64 = 0.01;
/// Terms of the polynomial. A plane with curvature approximates vignetting, a lamp beside the axis, and a slope.
const TERMS: usize = 6;
/// Number of fits. The background grows with each of them into dim corners.
const ROUNDS: usize = 24;
/// In the first rounds, when the surface does not have its slopes yet, samples darker by this share have half the
/// weight.
const FIRST_ROUNDS: usize = 6;
const DARKER: f64 = 0.1;
/// Position between object (0) and illumination (1) from which a sample is background.
const BACKGROUND: f64 = 0.55;
/// Quantile of the dark samples that represents the object.
const OBJECT_QUANTILE: f64 = 0.05;
/// Tukey's constant for 95 % efficiency, and the least scatter that it is multiplied by, as a share of the
/// illumination.
const TUKEY: f64 = 4.685;
const MIN_SCATTER: f64 = 0.01;

type Terms = SVector<f64, TERMS>;

/// The brightness of the back light without the object, as a share of full scale, everywhere on the canvas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Illumination {
    surface: Terms,
    centre: [f64; 2],
    unit: f64,
    /// Range of the surface on the background.
    darkest: f64,
    brightest: f64,
    /// Mean over the canvas.
    pub mean: f64,
}

/// A sampled pixel.
struct Sample {
    terms: Terms,
    value: f64,
    /// The surface of the last round.
    light: f64,
}

impl Illumination {
    /// Fits the background of a picture (`grey`: shares of full scale); none when there is too little of it.
    pub(super) fn fit(grey: &[f32], width: usize, height: usize, is_valid: impl Fn(usize) -> bool) -> Option<Self> {
        let centre = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        let unit = (width.max(height) as f64 / 2.0).max(1.0);
        let step = ((width * height / SAMPLES) as f64).sqrt().floor().max(1.0) as usize;
        let places = (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)));
        let mut samples: Vec<Sample> = places
            .filter(|&(x, y)| is_valid(y * width + x))
            .map(|(x, y)| Sample {
                terms: terms((x as f64 - centre[0]) / unit, (y as f64 - centre[1]) / unit),
                value: f64::from(grey[y * width + x]),
                light: 0.0,
            })
            .collect();
        let threshold = Histogram::of(samples.iter().map(|sample| sample.value as f32)).otsu()?.threshold;
        let (bright, dark): (Vec<f64>, Vec<f64>) = samples.iter().map(|s| s.value).partition(|&v| v >= threshold);
        let count = samples.len();
        let enough = |part: usize| part >= MIN_SAMPLES && part as f64 >= MIN_SHARE * count as f64;
        if !enough(bright.len()) {
            return None;
        }
        // dark samples include dim corners; the object is the darkest of them
        let (level, dark) = (quantile(bright, 0.5)?, quantile(dark, OBJECT_QUANTILE)?);
        samples.iter_mut().for_each(|sample| sample.light = level);

        let mut surface = Terms::zeros();
        let mut range = [level, level];
        for round in 0..ROUNDS {
            let is_background = |s: &Sample| match round {
                0 => s.value >= threshold,
                _ => s.value > dark + BACKGROUND * (s.light - dark),
            };
            let background: Vec<&Sample> = samples.iter().filter(|s| is_background(s)).collect();
            if !enough(background.len()) {
                return None;
            }
            let off = |s: &Sample| (s.value - s.light) / s.light;
            let middle = quantile(background.iter().map(|s| off(s)).collect(), 0.5)?;
            let scatter = quantile(background.iter().map(|s| (off(s) - middle).abs()).collect(), 0.5)?;
            let scale = TUKEY * (1.4826 * scatter).max(MIN_SCATTER);
            let weight = |s: &Sample| match round {
                ..FIRST_ROUNDS => 1.0 / (1.0 + (off(s).min(0.0) / DARKER).powi(2)),
                _ => (1.0 - (off(s) / scale).powi(2)).max(0.0).powi(2),
            };
            let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
            let mut right = Terms::zeros();
            range = [f64::INFINITY, 0.0];
            let mut weights = 0.0;
            for sample in background {
                let weight = weight(sample);
                normal += weight * sample.terms * sample.terms.transpose();
                right += weight * sample.value * sample.terms;
                weights += weight;
                if weight > 0.0 {
                    range = [range[0].min(sample.light), range[1].max(sample.light)];
                }
            }
            // regularisation, for a background that lies on a line
            normal += 1e-6 * weights * SMatrix::identity();
            surface = normal.cholesky()?.solve(&right);
            samples.iter_mut().for_each(|s| s.light = surface.dot(&s.terms).clamp(0.05 * level, 20.0 * level));
        }
        let [darkest, brightest] = range;
        let sane = darkest > 0.0 && brightest >= darkest && surface.iter().all(|term| term.is_finite());
        let mut illumination = Self { surface, centre, unit, darkest, brightest, mean: level };
        let sum: f64 = samples.iter().map(|sample| illumination.clamped(surface.dot(&sample.terms))).sum();
        illumination.mean = sum / samples.len() as f64;
        sane.then_some(illumination)
    }

    /// Loss of brightness from the brightest to the darkest background, 0 to 1.
    pub(super) fn falloff(&self) -> f64 {
        1.0 - self.darkest / self.brightest
    }

    /// Makes the light even: each value is multiplied by the mean illumination over the illumination at its pixel.
    pub(super) fn even_out(&self, grey: &mut [f32], width: usize) {
        grey.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            let v = (y as f64 - self.centre[1]) / self.unit;
            for (x, value) in row.iter_mut().enumerate() {
                let u = (x as f64 - self.centre[0]) / self.unit;
                let light = self.clamped(self.surface.dot(&terms(u, v)));
                *value *= (self.mean / light) as f32;
            }
        });
    }

    fn clamped(&self, light: f64) -> f64 {
        light.clamp(self.darkest, self.brightest)
    }
}

fn terms(u: f64, v: f64) -> Terms {
    Terms::from([1.0, u, v, u * u, u * v, v * v])
}

/// The quantile `share` of the values; none when there are none.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    quantile_floor(&mut values, share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A back light over 300 x 200 px with a dark object in the middle.
    fn lit(light: impl Fn(f64, f64) -> f64) -> Vec<f32> {
        let at = |x: usize, y: usize| {
            let (u, v) = (x as f64 / 299.0, y as f64 / 199.0);
            let noise = ((x * 7919 + y * 104_729) % 101) as f64 / 101.0 - 0.5;
            let object = (u - 0.5).abs() < 0.3 && (v - 0.4).abs() < 0.3;
            (if object { 0.03 } else { light(u, v) } + 0.01 * noise) as f32
        };
        (0..200).flat_map(|y| (0..300).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
    }

    #[test]
    fn a_slope_and_dim_corners_are_found_and_evened_out() {
        let lights: [fn(f64, f64) -> f64; 3] = [
            |u, _| 0.9 - 0.5 * u,
            |u, v| 0.9 * (1.0 - 0.6 * ((u - 0.5).powi(2) + (v - 0.5).powi(2)) / 0.5),
            |u, v| 0.8 * (1.0 - 0.5 * ((u - 0.1).powi(2) + (v - 0.9).powi(2))),
        ];
        for light in lights {
            let (mut grey, before) = (lit(light), lit(light));
            let found = Illumination::fit(&grey, 300, 200, |_| true).unwrap();
            found.even_out(&mut grey, 300);
            for at in (0..grey.len()).filter(|&at| before[at] > 0.1) {
                let off = f64::from(grey[at]) - found.mean;
                assert!(off.abs() < 0.05 * found.mean, "{} became {} at {at}", before[at], grey[at]);
            }
        }
    }

    #[test]
    fn wings_and_invalid_pixels_do_not_influence_the_fit() {
        let even = lit(|_, _| 0.8);
        let mut winged = even.clone();
        for (at, value) in winged.iter_mut().enumerate() {
            if at / 300 < 50 && at % 300 > 180 {
                *value = 0.55;
            }
            if at % 300 < 20 {
                *value = 1.0;
            }
        }
        let light = Illumination::fit(&winged, 300, 200, |at| at % 300 >= 20).unwrap();
        assert!((light.mean - 0.8).abs() < 0.01 && light.falloff() < 0.05, "{light:?}");
    }

    #[test]
    fn too_little_background_gives_no_fit() {
        assert_eq!(Illumination::fit(&[0.5; 600], 30, 20, |_| true), None);
        assert_eq!(Illumination::fit(&[], 0, 0, |_| true), None);
        let speck: Vec<f32> = (0..6000).map(|at| if at % 200 == 7 { 0.9 } else { 0.1 }).collect();
        assert_eq!(Illumination::fit(&speck, 100, 60, |_| true), None);
    }
}
