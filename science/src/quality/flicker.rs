//! Flicker: brightness of a slice relative to what the surrounding slices predict.
//!
//! The prediction is a Theil-Sen line through the surrounding slices: it follows a steady drift, also at the ends of
//! the stack, and is not moved by a single flash. It needs at least [`FEWEST`] surrounding slices, so stacks of fewer
//! than six slices have no flicker ratio: in them a flash cannot be told from a drift.

use crate::imaging::statistics::median_midpoint;

/// Slices on each side that predict the brightness of one.
const SIDE: usize = 3;
/// With fewer surrounding slices nothing is predicted: one bright slice among them would tilt the line.
pub(super) const FEWEST: usize = 5;

/// Per slice: its brightness over the predicted one; 1 for a steady drift. None where a slice has no brightness, or
/// fewer than [`FEWEST`] surrounding slices have one.
pub(super) fn ratios(brightness: &[Option<f64>]) -> Vec<Option<f64>> {
    let ratio = |(n, own): (usize, &Option<f64>)| {
        let expected = expected(brightness, n).filter(|expected| *expected > 0.0)?;
        Some((*own)? / expected)
    };
    brightness.iter().enumerate().map(ratio).collect()
}

/// Value at slice `n` of the Theil-Sen line through the slices around it; none with fewer than [`FEWEST`] of them.
fn expected(brightness: &[Option<f64>], n: usize) -> Option<f64> {
    let window = (2 * SIDE + 1).min(brightness.len());
    let first = n.saturating_sub(SIDE).min(brightness.len() - window);
    let around: Vec<(f64, f64)> = (first..first + window)
        .filter(|&i| i != n)
        .filter_map(|i| Some((i as f64 - n as f64, brightness[i]?)))
        .collect();
    if around.len() < FEWEST {
        return None;
    }
    let pairs = around.iter().enumerate().flat_map(|(i, a)| around[i + 1..].iter().map(move |b| (a, b)));
    let slope = median_midpoint(&mut pairs.map(|(a, b)| (b.1 - a.1) / (b.0 - a.0)).collect::<Vec<f64>>())?;
    median_midpoint(&mut around.iter().map(|(step, value)| value - slope * step).collect::<Vec<f64>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst_but(ratios: &[Option<f64>], but: usize) -> f64 {
        let others = ratios.iter().enumerate().filter(|(n, _)| *n != but);
        others.filter_map(|(_, ratio)| *ratio).map(|ratio| (ratio - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_steady_drift_is_not_flicker() {
        for count in 6..10 {
            let drift: Vec<Option<f64>> = (0..count).map(|n| Some(1.0 - 0.015 * f64::from(n))).collect();
            let found = ratios(&drift);
            assert!(found.iter().all(Option::is_some) && worst_but(&found, usize::MAX) < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn one_bright_slice_alone_flickers_wherever_it_is() {
        for bright in 0..9 {
            let stack: Vec<Option<f64>> = (0..9).map(|n| Some(if n == bright { 1.08 } else { 1.0 })).collect();
            let found = ratios(&stack);
            assert!((found[bright].unwrap() - 1.08).abs() < 1e-9, "{bright}: {found:?}");
            assert!(worst_but(&found, bright) < 1e-9, "{bright}: {found:?}");
        }
    }

    #[test]
    fn too_few_slices_have_no_flicker() {
        for count in 0..6 {
            let drift: Vec<Option<f64>> = (0..count).map(|n| Some(1.0 - 0.05 * n as f64)).collect();
            assert_eq!(ratios(&drift), vec![None; count]);
        }
        let unknown = [Some(1.0), Some(1.0), None, Some(1.0), Some(1.0), Some(1.0)];
        assert_eq!(ratios(&unknown), [None, None, None, None, None, None]);
        assert_eq!(ratios(&[Some(1.0); 6]), [Some(1.0); 6]);
    }
}
