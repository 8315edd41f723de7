//! How well one tone curve explains the brightness of a stack.

use super::gain_model::{GainModel, Point};
use super::ln::Ln;
use super::tone::{self, TONES, tone};

/// Standard deviation of the response of values to light at the bright level, relative to that of the tone curve.
const SLOPE_DOUBT: f64 = 0.4;
/// Standard deviation expected of the curvature of ln(light) over the stack beyond the inverse-square law.
const LIGHT_CURVATURE: f64 = 0.005;

/// What was measured of one slice, relative to the reference slice.
pub(super) struct Brightness {
    /// `ln` of the factor on light per tone curve; `None` where it was not measured.
    pub means: [Option<Ln>; TONES],
    /// `ln` of the factor on values, from the bright level; `None` where it is not visible.
    pub bright: Option<Ln>,
}

/// How one tone curve explains the stack.
pub(super) struct CurveFit {
    /// Points of the square root of the light over the rail, which is straight for a fixed lens.
    points: Vec<Point>,
    /// Scatter about the smooth model; `None` with too few slices for one.
    pub scatter: Option<f64>,
    /// Sum of squared deviations between mean light and bright level, in standard deviations.
    off_bright: f64,
    /// Response of the values at the bright level, relative to the curve's own.
    pub slope: f64,
    /// Its standard deviation.
    pub slope_sigma: f64,
    /// `ln` of the factor on values per slice.
    pub gains: Vec<Option<f64>>,
}

/// Least number of slices whose brightness over the rail says something about the tone curve.
const MODEL_SLICES: usize = 5;

impl CurveFit {
    pub(super) fn of(
        all: &[Option<Brightness>],
        k: usize,
        reference: usize,
        level: f64,
        positions: &[f64],
    ) -> Option<Self> {
        let mean = |i: usize| all[i].as_ref().and_then(|b| b.means[k]);
        mean(reference)?;
        let gains: Vec<Option<f64>> =
            (0..all.len()).map(|i| mean(i).and_then(|m| tone::value_gain(m.value, level, tone(k)))).collect();
        let points: Vec<Point> = (0..all.len())
            // the same slices for all curves, so that their costs can be compared
            .filter(|&i| all[i].as_ref().is_some_and(|b| b.means.iter().all(Option::is_some)))
            .filter_map(|i| {
                let mean = mean(i)?;
                let root = (0.5 * mean.value).exp();
                Some(Point { z: positions[i], value: root, sigma: 0.5 * root * mean.sigma })
            })
            .collect();
        let scatter = (points.len() >= MODEL_SLICES)
            .then(|| GainModel::fit(&points, 0.5 * LIGHT_CURVATURE, None))
            .flatten()
            .map(|model| model.scatter);
        // bright = slope * gain + offset; the offset is an error of the reference slice's bright level
        let pairs = (0..all.len()).filter(|&i| i != reference).filter_map(|i| {
            let bright = all[i].as_ref()?.bright?;
            Some((gains[i]?, bright.value, bright.sigma.hypot(mean(i)?.sigma).max(3e-4)))
        });
        let (mut xx, mut xy, mut yy) = (SLOPE_DOUBT.powi(-2), SLOPE_DOUBT.powi(-2), SLOPE_DOUBT.powi(-2));
        for (x, y, sigma) in pairs {
            let weight = sigma.powi(-2);
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
        }
        let slope = xy / xx;
        Some(Self {
            points,
            scatter,
            off_bright: (yy - slope * xy).max(0.0),
            slope,
            slope_sigma: xx.recip().sqrt(),
            gains,
        })
    }

    /// Twice the negative log-likelihood for light that scatters by `scatter` about a smooth model.
    pub(super) fn cost(&self, scatter: f64) -> f64 {
        let model = (self.points.len() >= MODEL_SLICES)
            .then(|| GainModel::fit(&self.points, 0.5 * LIGHT_CURVATURE, Some(scatter)))
            .flatten();
        model.map_or(0.0, |model| model.cost) + self.off_bright
    }
}
