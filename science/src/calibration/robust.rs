//! Robust homography from point pairs with outliers: least median of squares over random samples of four (Rousseeuw,
//! 1984). It needs no threshold and tolerates up to 50 % outliers.

use super::dlt::{self, Pair};
use super::statistics::{median, median_of};
use crate::types::Homography;

/// A homography and its inliers.
#[derive(Debug, Clone)]
pub(super) struct Consensus {
    /// Fitted to the inliers.
    pub homography: Homography,
    /// One flag per pair.
    pub is_inlier: Vec<bool>,
}

/// Random samples; with 40 % outliers one of 8 is free of outliers.
const SAMPLES: usize = 300;
/// Most pairs that a sample is scored on.
const JUDGES: usize = 400;

/// xorshift64* with a fixed seed: the same dots give the same homography.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % n
    }
}

/// Distance between the mapped first point and the second, px. Points on the horizon are infinitely far.
pub(super) fn transfer_error(homography: &Homography, pair: &Pair) -> f64 {
    let sent = homography.apply(pair.0);
    let far = (sent[0] - pair.1[0]).hypot(sent[1] - pair.1[1]);
    if far.is_finite() { far } else { f64::MAX }
}

/// The consensus homography. Its inlier limit is 3.5 sigma of the pairs' own scatter, clamped to `least..=most` px.
/// `None` when fewer than four pairs agree.
pub(super) fn consensus(pairs: &[Pair], least: f64, most: f64) -> Option<Consensus> {
    if pairs.len() < 4 {
        return None;
    }
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let stride = pairs.len().div_ceil(JUDGES);
    let judges: Vec<Pair> = pairs.iter().step_by(stride).copied().collect();
    let mut errors = Vec::with_capacity(judges.len());
    let mut judged = |h: &Homography| {
        errors.clear();
        errors.extend(judges.iter().map(|pair| transfer_error(h, pair)));
        median(&mut errors)
    };
    // the fit to all pairs first: without outliers nothing is better
    let mut best = dlt::fit(pairs).map(|h| (judged(&h), h));
    for _ in 0..SAMPLES {
        let chosen: [Pair; 4] = std::array::from_fn(|_| pairs[random.below(pairs.len())]);
        let Some(candidate) = dlt::fit(&chosen) else { continue };
        let score = judged(&candidate);
        if best.as_ref().is_none_or(|(b, _)| score < *b) {
            best = Some((score, candidate));
        }
    }
    let (mut score, mut homography) = best?;
    let mut is_inlier = vec![false; pairs.len()];
    for _ in 0..3 {
        // for a two-dimensional normal error the median distance is 1.18 sigma
        let reach = (3.5 * score / 1.18).clamp(least, most.max(least));
        for (flag, pair) in is_inlier.iter_mut().zip(pairs) {
            *flag = transfer_error(&homography, pair) <= reach;
        }
        let kept: Vec<Pair> = pairs.iter().zip(&is_inlier).filter(|(_, a)| **a).map(|(p, _)| *p).collect();
        homography = dlt::fit(&kept)?;
        score = median_of(kept.iter().map(|pair| transfer_error(&homography, pair)));
    }
    Some(Consensus { homography, is_inlier })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirty_percent_outliers_do_not_bias_the_homography() {
        let truth = Homography([1.04, 0.01, -30.0, -0.008, 1.05, 12.0, 4e-6, -3e-6, 1.0]);
        let mut random = Random(7);
        let mut unit = || random.below(10_000) as f64 / 10_000.0 - 0.5;
        let pairs: Vec<Pair> = (0..150)
            .map(|k| {
                let p = [100.0 + 60.0 * f64::from(k % 15), 80.0 + 60.0 * f64::from(k / 15)];
                let q = truth.apply(p);
                let wrong = if k % 10 < 3 { 40.0 } else { 0.1 };
                (p, [q[0] + wrong * unit(), q[1] + wrong * unit()])
            })
            .collect();
        let found = consensus(&pairs, 0.15, 5.0).expect("a consensus");
        assert!(found.homography.corner_distance(&truth, 1100, 760) < 0.06);
        let kept = found.is_inlier.iter().filter(|a| **a).count();
        assert!((100..=110).contains(&kept), "{kept}");
        let again = consensus(&pairs, 0.15, 5.0).expect("a consensus");
        assert_eq!(again.homography, found.homography);
    }

    #[test]
    fn too_few_pairs_give_no_consensus() {
        assert!(consensus(&[([0.0, 0.0], [1.0, 1.0]); 3], 0.1, 1.0).is_none());
        assert!(consensus(&[([0.0, 0.0], [1.0, 1.0]); 30], 0.1, 1.0).is_none());
    }
}
