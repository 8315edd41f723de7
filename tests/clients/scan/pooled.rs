//! The comparison with ideal pictures over several specimens: the standard deviation of 54 steps is uncertain by a
//! fifth, so the ratio of a single scan says little.

use std::fmt;

use super::colmap::Accuracy;

/// Samples of the bootstrap.
const SAMPLES: usize = 10_000;

/// What was found for one specimen.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    pub fused: Accuracy,
    pub ideal: Accuracy,
}

/// A ratio with the interval that holds it with 95 % confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    pub value: f64,
    pub interval: [f64; 2],
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, interval: [low, high] } = self;
        write!(f, "{value:.2} ({low:.2} to {high:.2})")
    }
}

/// The ratios for radius, pan step and tilt step: root mean square of the standard deviations over the specimens, fused
/// over ideal. The intervals are percentiles of a bootstrap over specimens (Efron 1979).
pub fn pooled(pairs: &[Pair]) -> [Ratio; 3] {
    [0, 1, 2].map(|which| {
        let squares: Vec<[f64; 2]> =
            pairs.iter().map(|pair| [pair.fused, pair.ideal].map(|a| a.deviations()[which].powi(2))).collect();
        let mut next = sequence();
        let mut ratios: Vec<f64> =
            (0..SAMPLES).map(|_| ratio((0..squares.len()).map(|_| squares[next(squares.len())]))).collect();
        ratios.sort_by(f64::total_cmp);
        let percentile = |share: f64| ratios[(share * (SAMPLES - 1) as f64).round() as usize];
        Ratio { value: ratio(squares.iter().copied()), interval: [percentile(0.025), percentile(0.975)] }
    })
}

fn ratio(squares: impl Iterator<Item = [f64; 2]>) -> f64 {
    let [fused, ideal] = squares.fold([0.0; 2], |sum, pair| [sum[0] + pair[0], sum[1] + pair[1]]);
    (fused / ideal).sqrt()
}

/// Whole numbers below a bound, from a fixed sequence (Knuth's MMIX).
fn sequence() -> impl FnMut(usize) -> usize {
    let mut state = 1_u64;
    move |bound| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % bound as u64) as usize
    }
}

#[test]
fn ratios_are_pooled_by_squares_and_their_interval_shrinks_with_equal_specimens() {
    let accuracy = |radius: f64| Accuracy { registered: 54, radial_percent: radius, pan_deg: 0.05, tilt_deg: 0.04 };
    let pair = |fused: f64, ideal: f64| Pair { fused: accuracy(fused), ideal: accuracy(ideal) };
    let [radius, pan, tilt] = pooled(&[pair(0.03, 0.01), pair(0.01, 0.03), pair(0.04, 0.05), pair(0.05, 0.04)]);
    assert!((radius.value - 1.0).abs() < 1e-12, "{radius}");
    assert!(radius.interval[0] < 0.75 && radius.interval[1] > 1.3, "{radius}");
    assert_eq!((pan, tilt), (Ratio { value: 1.0, interval: [1.0; 2] }, Ratio { value: 1.0, interval: [1.0; 2] }));
    let [same, ..] = pooled(&[pair(0.02, 0.01), pair(0.04, 0.02)]);
    assert!((same.value - 2.0).abs() < 1e-12 && (same.interval[1] - 2.0).abs() < 1e-12, "{same}");
}
