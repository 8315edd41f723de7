//! Gains from the brightness that neighbouring slices show of the same places.

use super::banded::Banded;
use super::matched::Pair;

/// Smallest and largest gain.
const RANGE: [f64; 2] = [0.05, 20.0];

/// Per slice the factor that makes it as bright as the reference slice: the least-squares solution of all pairs. 1 for
/// a slice whose brightness no pair shows.
pub(super) fn gains(pairs: &[Pair], count: usize, reference: usize) -> Vec<f64> {
    let farthest = pairs.iter().map(|pair| pair.slices[1] - pair.slices[0]).max().unwrap_or(1);
    let mut matrix = Banded::zeros(count, farthest);
    let mut right = vec![0.0; count];
    // a weak wish for no change keeps slices determined that no pair shows
    (0..count).for_each(|slice| matrix.add(slice, slice, if slice == reference { 1e12 } else { 1e-6 }));
    for pair in pairs {
        let Some([brighter, sigma]) = pair.brightness else { continue };
        let [a, b] = pair.slices;
        let weight = sigma.powi(-2);
        for (i, j, value) in [(a, a, weight), (b, b, weight), (b, a, -weight)] {
            matrix.add(i, j, value);
        }
        right[a] -= weight * brighter;
        right[b] += weight * brighter;
    }
    let Some(factor) = matrix.factor() else { return vec![1.0; count] };
    let found = factor.solve(&right);
    let gain = |(slice, ln): (usize, &f64)| match slice == reference {
        true => 1.0,
        false => (found[reference] - ln).exp().clamp(RANGE[0], RANGE[1]),
    };
    found.iter().enumerate().map(gain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gains_of_a_chain_follow_from_its_pairs() {
        let truth = [0.8, 0.9, 1.0, 1.2, 1.5_f64];
        let pair = |a: usize, b: usize| Pair {
            view: 0,
            slices: [a, b],
            windows: Vec::new(),
            // a slice that needs a larger gain is darker
            brightness: Some([(truth[a] / truth[b]).ln(), 1e-3]),
        };
        let pairs = [pair(0, 1), pair(1, 2), pair(0, 2), pair(2, 3)];
        let found = gains(&pairs, 5, 2);
        assert!(found[..4].iter().zip(&truth).all(|(a, b)| (a / b - 1.0).abs() < 1e-6), "{found:?}");
        assert!((found[4] - 1.0).abs() < 1e-3, "no pair shows it: {found:?}");
    }
}
