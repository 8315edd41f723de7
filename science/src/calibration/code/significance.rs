//! The probability that an agreement with the code is due to chance.

use std::f64::consts::{LN_2, LN_10};

/// Decadic logarithm of an upper bound of the probability that `sum c_k w_k >= agreement`, where the `c_k` are
/// independent and 1 or -1 with equal probability and the `w_k` are the `weights` (Chernoff):
///
/// `min over t >= 0 of exp(-t agreement) prod cosh(t w_k)`
///
/// The bound holds for readings of any origin: what is random is the code, which was fixed before.
pub(super) fn chance(agreement: f64, weights: &[f64]) -> f64 {
    let most: f64 = weights.iter().map(|w| w.abs()).sum();
    if agreement <= 0.0 || most <= 0.0 {
        return 0.0;
    }
    // every dot agrees: t grows without limit
    if agreement >= most * (1.0 - 1e-9) {
        return -(weights.iter().filter(|w| **w != 0.0).count() as f64) * LN_2 / LN_10;
    }
    let slope = |t: f64| weights.iter().map(|w| w * (t * w).tanh()).sum::<f64>() - agreement;
    let (mut low, mut high) = (0.0, 1.0);
    while slope(high) < 0.0 && high < 1e6 {
        high *= 2.0;
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if slope(middle) < 0.0 { low = middle } else { high = middle }
    }
    let t = 0.5 * (low + high);
    let log_cosh = |x: f64| x.abs() + (-2.0 * x.abs()).exp().ln_1p() - LN_2;
    let bound = weights.iter().map(|w| log_cosh(t * w)).sum::<f64>() - t * agreement;
    bound.min(0.0) / LN_10
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_exact_where_all_agree_and_above_the_binomial_tail_elsewhere() {
        let ones = [1.0; 40];
        assert!((chance(40.0, &ones) - 40.0 * 0.5_f64.log10()).abs() < 1e-6);
        // P(at least 35 of 40 agree)
        let tail: f64 = [(35, 658_008.0), (36, 91_390.0), (37, 9_880.0), (38, 780.0), (39, 40.0), (40, 1.0)]
            .map(|(_, ways): (u32, f64)| ways * 0.5_f64.powi(40))
            .iter()
            .sum();
        let bound = chance(30.0, &ones);
        assert!((tail.log10()..tail.log10() + 1.0).contains(&bound), "{bound} for {}", tail.log10());
        assert_eq!(chance(-3.0, &ones), 0.0);
        assert_eq!(chance(0.0, &[]), 0.0);
    }

    #[test]
    fn weak_readings_hardly_count() {
        let mut weights = vec![1.0; 40];
        weights.extend([0.05; 10]);
        let without = chance(38.0, &weights[..40]);
        assert!((chance(37.5, &weights) - without).abs() < 1.2);
    }
}
