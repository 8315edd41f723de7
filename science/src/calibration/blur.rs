//! From how much of the grid's first harmonic is left to the radius of the blur.
//!
//! Blur by a disc of radius r multiplies a wave of one period per step by `2 J1(x) / x`, `x = 2 pi r / step`; it
//! vanishes at r = 0.61 steps and is negative beyond (spurious resolution).

use std::f64::consts::TAU;

/// Blur radius, in steps, at which the first harmonic vanishes.
pub(super) const VANISHES: f64 = 0.6098;
/// Blur radius, in steps, at which it is most negative.
const LOWEST: f64 = 0.8174;

/// What a blur of `radius` steps leaves of the first harmonic.
pub(super) fn left(radius: f64) -> f64 {
    let x = TAU * radius;
    if x < 1e-3 { 1.0 - x * x / 8.0 } else { 2.0 * j1(x) / x }
}

/// The radius in steps that leaves `share` of the first harmonic: 0 when all is left, at most where it is most negative.
pub(super) fn radius(share: f64) -> f64 {
    let (mut low, mut high) = (0.0, LOWEST);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if left(middle) > share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Bessel function of the first kind and order one, by its series (converges fast for the |x| < 6 of this module).
fn j1(x: f64) -> f64 {
    let quarter = -x * x / 4.0;
    let (mut term, mut sum) = (x / 2.0, x / 2.0);
    for k in 1..40 {
        term *= quarter / (f64::from(k) * f64::from(k + 1));
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
    }

    #[test]
    fn radius_and_what_is_left_are_inverse_to_one_another_past_the_inversion_too() {
        for r in [0.02, 0.1, 0.3, 0.45, 0.6, 0.7, 0.8] {
            assert!((radius(left(r)) - r).abs() < 1e-6, "{r}");
        }
        assert!(left(VANISHES).abs() < 1e-3 && left(0.7) < -0.05);
        assert_eq!(radius(1.2).round(), 0.0);
    }
}
