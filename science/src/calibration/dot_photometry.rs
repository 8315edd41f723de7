//! Dot photometry: the brightness of the target at each dot, from which the gains follow.
//!
//! Two measures:
//!
//! - *Bright level*: the ground midway between four dots, or the centre of a bright dot. Exact for every tone curve,
//!   but affected by blur: beyond about 0.4 of the pitch for a disc (0.2 for bright dots), earlier for a Gaussian.
//! - *Mean* over whole grid steps, of stored values and of light. The mean light is not affected by blur of any shape,
//!   but the stored values are a tone curve of the light.
//!
//! `gains` combines them.

use super::flat_field::{FlatField, Polarity};
use super::phase::{self, PhaseMeasurement, Window};
use super::statistics::{mad_sigma, median};
use super::working_image::sample;
use crate::imaging::Plane;

/// Brightness at one dot, grey levels 0..255.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DotBrightness {
    /// Mean over whole grid steps, with missing dots drawn in.
    pub mean: f64,
    /// The same in linear light, 0..1, with the values taken as sRGB; `None` where it was not measured.
    pub linear_mean: Option<f64>,
    /// The bright level: between dark dots, or on bright ones; `None` outside the image.
    pub bright: Option<f64>,
}

/// Measures the brightness around the dot at `at` (px of the plane).
pub(super) fn measure_brightness(
    plane: &Plane<f32>,
    field: &FlatField,
    filled: &Plane<f32>,
    at: [f64; 2],
    steps: [[f64; 2]; 2],
    phase: &PhaseMeasurement,
) -> DotBrightness {
    let ground = field.ground_at(at);
    let mean = match field.polarity {
        Polarity::DarkOnLight => ground * (1.0 - phase.mean),
        Polarity::LightOnDark => ground + field.span * phase.mean,
    };
    // half size of the averaged spot, in steps: small against the gap, but more than a few samples
    let spot = 0.06;
    let level = |p: [f64; 2]| {
        let around = [[0.0, 0.0], [spot, 0.0], [-spot, 0.0], [0.0, spot], [0.0, -spot]];
        let mut sum = 0.0;
        for [a, b] in around {
            let q = [0, 1].map(|k| p[k] + a * steps[0][k] + b * steps[1][k]);
            // where a dot was drawn in, the image itself does not show the bright level
            if sample(filled, q)?.abs() > 0.02 {
                return None;
            }
            sum += f64::from(sample(plane, q)?);
        }
        Some(sum / around.len() as f64)
    };
    let bright = match field.polarity {
        Polarity::LightOnDark => level(at),
        Polarity::DarkOnLight => {
            let corners = [[0.5, 0.5], [0.5, -0.5], [-0.5, 0.5], [-0.5, -0.5]];
            let levels: Vec<f64> = corners
                .iter()
                .filter_map(|[a, b]| level([0, 1].map(|k| at[k] + a * steps[0][k] + b * steps[1][k])))
                .collect();
            (levels.len() == 4).then(|| levels.iter().sum::<f64>() / 4.0)
        }
    };
    DotBrightness { mean, linear_mean: None, bright }
}

/// Mean of the linear light in each window, 0..1, with the values taken as sRGB and missing dots drawn in.
pub(super) fn linear_means(
    plane: &Plane<f32>,
    field: &FlatField,
    filled: &Plane<f32>,
    windows: &[Window],
) -> Vec<Option<f64>> {
    let width = plane.width;
    let values = plane.data.iter().zip(&filled.data).enumerate().map(|(k, (value, filled))| {
        let missing = if filled.abs() < 1e-4 { 0.0 } else { f64::from(*filled) };
        let value = match (missing == 0.0, field.polarity) {
            (true, _) => f64::from(*value),
            (_, Polarity::DarkOnLight) => {
                f64::from(*value) - missing * field.ground_at([(k % width) as f64, (k / width) as f64])
            }
            (_, Polarity::LightOnDark) => f64::from(*value) + missing * field.span,
        };
        to_light(value) as f32
    });
    let light = Plane { width, height: plane.height, data: values.collect() };
    phase::measure(&light, None, windows).into_iter().map(|l| l.map(|l| l.mean)).collect()
}

/// Linear light 0..1 of an sRGB value 0..255 (IEC 61966-2-1).
pub(super) fn to_light(value: f64) -> f64 {
    let v = (value / 255.0).max(0.0);
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Largest radius of a disc blur, in grid steps, that does not affect the bright level, for dots of diameter `fill`
/// steps.
pub(super) fn bright_reach(fill: f64, polarity: Polarity) -> f64 {
    let edge = match polarity {
        // from the centre between four dots to the edge of each
        Polarity::DarkOnLight => std::f64::consts::FRAC_1_SQRT_2 - fill / 2.0,
        Polarity::LightOnDark => fill / 2.0,
    };
    (edge - 0.09).max(0.02)
}

/// Median over shared dots of reference over slice, which is the gain of the slice, and its relative standard
/// deviation. `None` when fewer than six dots have the measure in both.
pub(super) fn ratio(pairs: impl Iterator<Item = (Option<f64>, Option<f64>)>) -> Option<(f64, f64)> {
    let mut ratios: Vec<f64> =
        pairs.filter_map(|(slice, base)| Some(base? / slice.filter(|s| *s > 0.5)?)).filter(|r| r.is_finite()).collect();
    if ratios.len() < 6 {
        return None;
    }
    let value = median(&mut ratios);
    // standard error of a median over overlapping windows
    let sigma =
        mad_sigma(ratios.iter().map(|r| r - value)) * (1.57 * phase::WINDOW_OVERLAP / ratios.len() as f64).sqrt();
    Some((value, sigma / value.abs().max(1e-9)))
}
