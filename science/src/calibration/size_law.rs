//! How the size of the target follows the rail: the law from which both pupil distances come.
//!
//! In: sizes of the measured slices, relative to the reference slice, and rail positions `z` that count towards the
//! object. Out: the coefficients of
//!
//! ```text
//! s(z) = a (1 + z / E) / (1 - z / D),   fitted as   s = a (1 + g z) + (1 / D) z (s - a)   with   g = 1 / E + 1 / D
//! ```
//!
//! where the lens alone moves (see [`crate::types::lens`]). A rail that moves camera and lens is the case `1 / E = 0`;
//! a rail that moves the sensor is the case `1 / D = 0` with `E` negative. So the bend `(1 / D) / g` is 0 with a moving
//! sensor, 1 with a moving camera, and between them with a lens that moves alone, whatever the sign and the unit of the
//! positions. The factor `a` takes up the error of the reference slice.

use nalgebra::{DMatrix, DVector};

use super::statistics::range;
use crate::types::profile::CaptureMode;

/// The scale of one measured slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScaleSample {
    /// Rail position relative to the reference slice: mm towards the object when the user specified positions, else
    /// slices.
    pub position: f64,
    /// Size of the target relative to the reference slice.
    pub size: f64,
    /// Standard deviation of the size.
    pub sigma: f64,
}

/// The fitted law. Reciprocal distances are per unit of the position.
#[derive(Debug, Clone, Copy)]
pub(super) struct SizeLaw {
    /// `g`: relative growth at the reference slice.
    pub growth: f64,
    /// Its standard deviation.
    pub growth_sigma: f64,
    /// `(1 / D) / g`.
    pub bend: f64,
    /// Its standard deviation; 0 where the mode defines it.
    pub bend_sigma: f64,
}

impl SizeLaw {
    /// Fits the law of `mode`; without a mode, and for a lens that moves alone, both coefficients are free. `None` when
    /// the slices do not determine it.
    pub(super) fn fit(samples: &[ScaleSample], mode: Option<CaptureMode>) -> Option<Self> {
        let (low, high) = range(samples.iter().map(|s| s.position));
        let span = (high - low).max(1e-12);
        let row = |s: &ScaleSample| {
            let z = s.position / span;
            match mode {
                Some(CaptureMode::FixedLens) => vec![1.0, z],
                Some(CaptureMode::MovingLens) => vec![1.0, z * s.size],
                Some(CaptureMode::LensAlone) | None => vec![1.0, z, z * (s.size - 1.0)],
            }
        };
        let unknowns = row(samples.first()?).len();
        if samples.len() <= unknowns {
            return None;
        }
        let (mut normal, mut right) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        for s in samples {
            let row = DVector::from_vec(row(s));
            let weight = s.sigma.powi(-2);
            normal += weight * &row * row.transpose();
            right += weight * s.size * row;
        }
        let inverse = normal.try_inverse()?;
        let found = &inverse * right;
        let left = |s: &ScaleSample| ((s.size - DVector::from_vec(row(s)).dot(&found)) / s.sigma).powi(2);
        let freedom = (samples.len() - unknowns) as f64;
        // slices that scatter more than their dots allow tell less
        let scatter = (samples.iter().map(left).sum::<f64>() / freedom).max(1.0).sqrt();
        let sigma = |n: usize| scatter * inverse[(n, n)].max(0.0).sqrt();
        let growth = found[1] / found[0];
        let (bend, bend_sigma) = match mode {
            Some(CaptureMode::FixedLens) => (0.0, 0.0),
            Some(CaptureMode::MovingLens) => (1.0, 0.0),
            Some(CaptureMode::LensAlone) | None => (found[2] / growth, sigma(2) / growth.abs()),
        };
        let law = Self { growth: growth / span, growth_sigma: sigma(1) / span, bend, bend_sigma };
        (law.growth.is_finite() && law.growth != 0.0 && bend.is_finite()).then_some(law)
    }

    /// The coordinate over which the size is linear, `u = z / (1 - z / D)`: `s = a (1 + g u)`. The shift of an image by
    /// a rail that is not parallel to the optical axis is linear in it too.
    pub(super) fn straight(&self, position: f64) -> f64 {
        position / (1.0 - self.bend * self.growth * position)
    }

    /// The position at which [`SizeLaw::straight`] is `coordinate`.
    pub(super) fn position(&self, coordinate: f64) -> f64 {
        coordinate / (1.0 + self.bend * self.growth * coordinate)
    }

    /// Relative standard deviation of the growth, and so of a distance that follows from it.
    pub(super) fn relative_sigma(&self) -> f64 {
        (self.growth_sigma / self.growth).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;
    use crate::types::lens::Lens;

    #[test]
    fn the_law_gives_the_pupil_distance_of_every_mode_and_lens_with_a_true_sigma() {
        let mut noise = Noise(7);
        let (mut outside, mut trials) = (0, 0);
        for pupil_ratio in [0.6, 1.0, 1.8] {
            for magnification in [0.5, 1.0, 2.5] {
                let lens = Lens { focal_mm: 65.0, magnification, pupil_ratio };
                let (e, d) = (lens.exit_pupil_distance(), lens.entrance_pupil_distance());
                for (mode, growth) in [
                    (CaptureMode::FixedLens, -1.0 / e),
                    (CaptureMode::MovingLens, 1.0 / d),
                    (CaptureMode::LensAlone, 1.0 / e + 1.0 / d),
                ] {
                    let step = 0.006 / growth.abs();
                    let samples: Vec<ScaleSample> = (-4..=4)
                        .map(|i| f64::from(i) * step)
                        .map(|z| (z, lens.size(mode, z) + 2e-5 * noise.normal()))
                        .map(|(position, size)| ScaleSample { position, size, sigma: 2e-5 })
                        .collect();
                    for law in [Some(mode), None].map(|mode| SizeLaw::fit(&samples, mode).expect("a law")) {
                        trials += 1;
                        outside += i32::from((law.growth - growth).abs() > 3.0 * law.growth_sigma);
                        assert!(law.relative_sigma() < 1e-3, "{lens:?} {mode:?}");
                    }
                    let free = SizeLaw::fit(&samples, None).expect("a law");
                    let law = SizeLaw::fit(&samples, Some(mode)).expect("a law");
                    for z in [-4.0 * step, step, 4.0 * step] {
                        assert!(
                            (1.0 + law.growth * law.straight(z) - lens.size(mode, z)).abs() < 1e-4,
                            "{lens:?} {mode:?}"
                        );
                        assert!((law.position(law.straight(z)) - z).abs() < 1e-12);
                    }
                    let bend = match mode {
                        CaptureMode::FixedLens => 0.0,
                        CaptureMode::MovingLens => 1.0,
                        CaptureMode::LensAlone => 1.0 / d / growth,
                    };
                    assert!((free.bend - bend).abs() < 4.0 * free.bend_sigma, "{lens:?} {mode:?}: {free:?}");
                }
            }
        }
        assert!(outside <= 1, "{outside} of {trials}");
    }
}
