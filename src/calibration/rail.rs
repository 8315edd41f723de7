//! The law that binds the slices of one rail together.
//!
//! With the sensor moved by equal steps, a point of the reference slice is seen in slice i at
//! `x_i = x + dz_i (a x + e)`: scale and shift of the way from the reference slice **to** slice i are linear
//! in the slice's index. This tells where a slice lies whose own dots are too blurred to say, and, because a
//! moving lens obeys another law, which of the two moved.

use nalgebra::Matrix3;

use crate::model::{Homography, profile::CaptureMode};

/// A slice whose homography was measured.
#[derive(Debug, Clone, Copy)]
pub struct Known {
    /// Index of the slice.
    pub index: usize,
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// Standard deviation of its worst corner, px.
    pub sigma: f64,
}

/// The law fitted to a stack: each number of the homography reference -> slice is a straight line in the
/// index.
#[derive(Debug, Clone)]
pub struct Law {
    intercept: [f64; 8],
    slope: [f64; 8],
    /// RMS distance between the corners that the law predicts and the measured ones, px.
    pub corner_rms: f64,
}

/// Corner sigmas below this do not make a slice count more.
const SIGMA_FLOOR: f64 = 0.05;

impl Law {
    /// Fits the law; `None` with fewer than three known slices (a line through two is always right).
    pub fn fit(known: &[Known], width: u32, height: u32) -> Option<Self> {
        if known.len() < 3 {
            return None;
        }
        let ways: Vec<(f64, f64, [f64; 9])> = known
            .iter()
            .map(|k| {
                let weight = 1.0 / k.sigma.max(SIGMA_FLOOR).powi(2);
                k.homography.inverse().map(|way| (k.index as f64, weight, way.0))
            })
            .collect::<Option<_>>()?;
        let total: f64 = ways.iter().map(|w| w.1).sum();
        let middle = ways.iter().map(|w| w.1 * w.0).sum::<f64>() / total;
        let spread: f64 = ways.iter().map(|w| w.1 * (w.0 - middle).powi(2)).sum();
        let (mut intercept, mut slope) = ([0.0; 8], [0.0; 8]);
        for n in 0..8 {
            let mean = ways.iter().map(|w| w.1 * w.2[n]).sum::<f64>() / total;
            slope[n] = ways.iter().map(|w| w.1 * (w.0 - middle) * (w.2[n] - mean)).sum::<f64>() / spread;
            intercept[n] = mean - slope[n] * middle;
        }
        let mut law = Self { intercept, slope, corner_rms: 0.0 };
        let mut square = 0.0;
        for k in known {
            square += law.predict(k.index)?.corner_distance(&k.homography, width, height).powi(2);
        }
        // a line has used up two of the slices
        law.corner_rms = (square / (known.len() as f64 - 2.0)).sqrt();
        law.corner_rms.is_finite().then_some(law)
    }

    /// Slice px -> reference-slice px of slice `index`.
    pub fn predict(&self, index: usize) -> Option<Homography> {
        let at = |n: usize| self.intercept[n] + self.slope[n] * index as f64;
        let way = Matrix3::new(at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7), 1.0);
        Homography::from_matrix(&way.try_inverse()?)
    }
}

/// What moved, when the scales of the slices leave no doubt (rail steps being equal): with a fixed lens 1/scale
/// is linear in the index, with a moving lens and a flat target the scale itself is.
pub fn capture_mode(known: &[Known], width: u32, height: u32) -> Option<CaptureMode> {
    if known.len() < 5 {
        return None;
    }
    let centre = [(f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0];
    let half = centre[0].hypot(centre[1]);
    let scales: Vec<(f64, f64)> = known.iter().map(|k| (k.index as f64, k.homography.scale_at(centre))).collect();
    let fixed = off_line(scales.iter().map(|(i, s)| (*i, 1.0 / s)));
    let moving = off_line(scales.iter().copied());
    let mut sigmas: Vec<f64> = known.iter().map(|k| k.sigma.max(0.01) / half).collect();
    let noise = super::working::median(&mut sigmas);
    let certain = |right: f64, wrong: f64| right < 0.2 * wrong && wrong > 5.0 * noise && right < 3.0 * noise;
    match () {
        () if certain(fixed, moving) => Some(CaptureMode::FixedLens),
        () if certain(moving, fixed) => Some(CaptureMode::MovingLens),
        () => None,
    }
}

/// RMS distance of values from the straight line that fits them best.
fn off_line(points: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = points.clone().count() as f64;
    let (sx, sy) = points.clone().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    let (mx, my) = (sx / n, sy / n);
    let (xx, xy) = points.clone().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mx).powi(2), s.1 + (p.0 - mx) * (p.1 - my)));
    let slope = xy / xx.max(1e-12);
    (points.map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2)).sum::<f64>() / (n - 2.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(scale: impl Fn(f64) -> f64) -> Vec<Known> {
        (0..9)
            .map(|index| {
                let s = scale(index as f64 - 4.0);
                let drift = 0.3 * (index as f64 - 4.0);
                let shift = [400.0 - s * (400.0 + drift), 300.0 - s * 300.0];
                Known { index, homography: Homography::similarity(s, shift), sigma: 0.03 }
            })
            .collect()
    }

    #[test]
    fn a_slice_that_was_not_measured_is_predicted() {
        let all = stack(|dz| 141.0 / (141.0 + 3.0 * dz));
        let known: Vec<Known> = all.iter().copied().filter(|k| k.index != 0 && k.index != 6).collect();
        let law = Law::fit(&known, 800, 600).expect("a law");
        assert!(law.corner_rms < 0.01, "{}", law.corner_rms);
        for index in [0, 6] {
            let predicted = law.predict(index).expect("a homography");
            assert!(predicted.corner_distance(&all[index].homography, 800, 600) < 0.01);
        }
        assert!(Law::fit(&known[..2], 800, 600).is_none());
    }

    #[test]
    fn the_law_owns_up_when_the_rail_did_not_move_evenly() {
        let mut known = stack(|dz| 141.0 / (141.0 + 3.0 * dz));
        known[2].homography = Homography::similarity(1.01, [9.0, -7.0]);
        assert!(Law::fit(&known, 800, 600).expect("a law").corner_rms > 2.0);
    }

    #[test]
    fn what_moved_is_told_only_when_the_scales_tell_it() {
        assert_eq!(capture_mode(&stack(|dz| 141.0 / (141.0 + 3.0 * dz)), 800, 600), Some(CaptureMode::FixedLens));
        assert_eq!(capture_mode(&stack(|dz| 1.0 - dz / 47.0), 800, 600), Some(CaptureMode::MovingLens));
        assert_eq!(capture_mode(&stack(|dz| 1.0 - dz / 1e5), 800, 600), None);
        assert_eq!(capture_mode(&stack(|dz| 1.0 + 0.01 * (dz * 2.0).sin()), 800, 600), None);
    }
}
