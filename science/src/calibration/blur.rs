//! The blur radius from the attenuation of the grid's first harmonic.
//!
//! A disc of radius r attenuates a wave with one period per grid step by `2 J1(x) / x`, `x = 2 pi r / step`. The factor
//! is 0 at r = 0.61 steps and negative beyond (spurious resolution).

use std::f64::consts::TAU;

/// Blur radius, in steps, at which the attenuation factor is 0.
pub(super) const VANISHES: f64 = 0.6098;
/// Blur radius, in steps, at which the factor is most negative.
const LOWEST: f64 = 0.8174;

/// Attenuation factor of the first harmonic for a blur of `radius` steps.
pub(super) fn attenuation(radius: f64) -> f64 {
    let x = TAU * radius;
    if x < 1e-3 { 1.0 - x * x / 8.0 } else { 2.0 * j1(x) / x }
}

/// Inverse of [`attenuation`]: the radius in steps for the factor `share`; 0 from a factor of 1, at most the radius of
/// the minimum.
pub(super) fn radius(share: f64) -> f64 {
    let (mut low, mut high) = (0.0, LOWEST);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if attenuation(middle) > share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Shift of the first harmonic's phase by a disc blur of `radius` steps whose light has a relative gradient of 1 per
/// step, in steps: `r J2(k r) / (k J1(k r))` with `k = 2 pi`; without limit where the harmonic vanishes, and against
/// the gradient beyond.
pub(super) fn tilt_shift(radius: f64) -> f64 {
    let x = TAU * radius;
    if x < 1e-3 { 0.0 } else { radius * j2(x) / (TAU * j1(x).abs().max(1e-6).copysign(j1(x))) }
}

/// Bessel function of the first kind of order one.
fn j1(x: f64) -> f64 {
    bessel(1, x / 2.0, x)
}

/// Bessel function of the first kind of order two.
fn j2(x: f64) -> f64 {
    bessel(2, x * x / 8.0, x)
}

/// Bessel function of the first kind, by its power series, which converges fast for the |x| < 6 used here. `first` is
/// the first term, `(x / 2)^order / order!`.
fn bessel(order: i32, first: f64, x: f64) -> f64 {
    let quarter = -x * x / 4.0;
    let (mut term, mut sum) = (first, first);
    for k in 1..40 {
        term *= quarter / (f64::from(k) * f64::from(k + order));
        sum += term;
        if term.abs() < 1e-16 {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bessel_function_has_its_known_values() {
        for (x, value) in
            [(0.5, 0.242_268_457_7), (1.841_183_8, 0.581_865_224_2), (3.831_705_97, 0.0), (5.0, -0.327_579_137_6)]
        {
            assert!((j1(x) - value).abs() < 1e-8, "J1({x}) = {}", j1(x));
        }
        for (x, value) in [(0.5, 0.030_604_023_5), (5.135_622_3, 0.0)] {
            assert!((j2(x) - value).abs() < 1e-8, "J2({x}) = {}", j2(x));
        }
    }

    #[test]
    fn the_radius_inverts_the_attenuation_beyond_the_zero_too() {
        for r in [0.02, 0.1, 0.3, 0.45, 0.6, 0.7, 0.8] {
            assert!((radius(attenuation(r)) - r).abs() < 1e-6, "{r}");
        }
        assert!(attenuation(VANISHES).abs() < 1e-3 && attenuation(0.7) < -0.05);
        assert_eq!(radius(1.2).round(), 0.0);
    }
}
