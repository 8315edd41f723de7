//! The comparison with ideal pictures over several specimens: the standard deviation of 54 steps is uncertain by a
//! fifth, so the ratio of a single scan says little.

use std::fmt;

use super::colmap::Accuracy;

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
/// over ideal. The intervals are by Student's t, with the standard error of the logarithm from a jackknife that omits
/// one specimen at a time (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11). The percentiles
/// of a bootstrap over six specimens would be a third too narrow. Unbounded for a single specimen.
pub fn pooled(pairs: &[Pair]) -> [Ratio; 3] {
    [0, 1, 2].map(|which| {
        let squares: Vec<[f64; 2]> =
            pairs.iter().map(|pair| [pair.fused, pair.ideal].map(|a| a.deviations()[which].powi(2))).collect();
        let (value, count) = (ratio(squares.iter().copied()), squares.len() as f64);
        let without = |omitted: usize| {
            let kept = squares.iter().enumerate().filter(|&(at, _)| at != omitted);
            ratio(kept.map(|(_, squares)| *squares)).ln()
        };
        let parts: Vec<f64> = (0..squares.len()).map(without).collect();
        let mean = parts.iter().sum::<f64>() / count;
        let error = ((count - 1.0) / count * parts.iter().map(|part| (part - mean).powi(2)).sum::<f64>()).sqrt();
        let times = if pairs.len() < 2 { f64::INFINITY } else { (student(pairs.len() - 1) * error).exp() };
        Ratio { value, interval: [value / times, value * times] }
    })
}

fn ratio(squares: impl Iterator<Item = [f64; 2]>) -> f64 {
    let [fused, ideal] = squares.fold([0.0; 2], |sum, pair| [sum[0] + pair[0], sum[1] + pair[1]]);
    (fused / ideal).sqrt()
}

/// The quantile 0.975 of Student's t with `freedom` degrees of freedom, at least 1; from 10 on to 0.003.
fn student(freedom: usize) -> f64 {
    const FEW: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];
    let many = freedom as f64;
    FEW.get(freedom - 1).copied().unwrap_or(1.96 + 2.372 / many + 2.822 / many.powi(2))
}

#[test]
fn ratios_are_pooled_by_squares_and_their_interval_shrinks_with_equal_specimens() {
    let accuracy = |radius: f64| Accuracy { registered: 54, radial_percent: radius, pan_deg: 0.05, tilt_deg: 0.04 };
    let pair = |fused: f64, ideal: f64| Pair { fused: accuracy(fused), ideal: accuracy(ideal) };
    let [radius, pan, tilt] = pooled(&[pair(0.03, 0.01), pair(0.01, 0.03), pair(0.04, 0.05), pair(0.05, 0.04)]);
    assert!((radius.value - 1.0).abs() < 1e-12, "{radius}");
    assert!(radius.interval[0] < 0.75 && radius.interval[1] > 1.3, "{radius}");
    assert_eq!((pan, tilt), (Ratio { value: 1.0, interval: [1.0; 2] }, Ratio { value: 1.0, interval: [1.0; 2] }));
    assert!((student(5) - 2.571).abs() < 1e-9 && (student(20) - 2.086).abs() < 0.003);
    let [same, ..] = pooled(&[pair(0.02, 0.01), pair(0.04, 0.02)]);
    assert!((same.value - 2.0).abs() < 1e-12 && (same.interval[1] - 2.0).abs() < 1e-12, "{same}");
}

/// The radii of the table of `docs/POSES.md`, calibrated and ideal.
#[test]
fn the_intervals_are_those_of_the_page() {
    let calibrated = [0.0192, 0.0203, 0.0192, 0.0223, 0.0190, 0.0155];
    let ideal = [0.0255, 0.0151, 0.0181, 0.0196, 0.0172, 0.0179];
    let accuracy = |radius: f64| Accuracy { registered: 54, radial_percent: radius, pan_deg: 0.05, tilt_deg: 0.04 };
    let pair = |(fused, ideal): (&f64, &f64)| Pair { fused: accuracy(*fused), ideal: accuracy(*ideal) };
    let [radius, ..] = pooled(&calibrated.iter().zip(&ideal).map(pair).collect::<Vec<_>>());
    assert_eq!(radius.to_string(), "1.01 (0.79 to 1.29)");
}
