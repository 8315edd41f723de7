//! Flicker: brightness of a slice relative to what the surrounding slices predict.
//!
//! The prediction is a Theil-Sen line through the surrounding slices: it follows a steady drift, also at the ends of
//! the stack, and is not moved by a single flash. It needs at least [`FEWEST`] surrounding slices, so stacks of fewer
//! than six slices have no flicker ratio: in them a flash cannot be told from a drift.

use super::slice::Brightness;
use crate::imaging::statistics::median_midpoint;

/// Brightness that differs by more than this share is visible where two slices meet.
pub(super) const VISIBLE: f64 = 0.03;
/// A slice of less than this share of the expected brightness is not corrected: its noise would grow too much.
const DARKEST: f64 = 0.5;
/// In a stack too short for [`ratios`], one slice is brighter or darker than the others if these agree to within this
/// share of its deviation.
const AGREED: f64 = 1.0 / 3.0;

/// Slices on each side that predict the brightness of one.
const SIDE: usize = 3;
/// With fewer surrounding slices nothing is predicted: one bright slice among them would tilt the line.
pub(super) const FEWEST: usize = 5;

/// Per slice: the factors of red, green and blue that give it the brightness and colour of the slices around; none for
/// a slice that does not differ visibly. `gains` are those of the profile, which were applied to the slices.
pub fn corrections(slices: &[Brightness], gains: &[f64], reference: usize) -> Vec<Option<[f32; 3]>> {
    let (Some(of_reference), Some(its_gain)) = (slices.get(reference), gains.get(reference)) else {
        return vec![None; slices.len()];
    };
    let after_gains = |channel: usize| -> Vec<Option<f64>> {
        let of_slice = |(slice, gain): (&Brightness, &f64)| {
            let ratio = slice.channel_ratio(of_reference, channel)? * gain / its_gain;
            (ratio.is_finite() && ratio > 0.0).then_some(ratio)
        };
        slices.iter().zip(gains).map(of_slice).collect()
    };
    let [luma, red, green, blue] = [0, 1, 2, 3].map(|channel| deviations(&after_gains(channel), reference));
    let of_slice = |n: usize| {
        let all = [luma[n], red[n], green[n], blue[n]];
        let is_visible = all.iter().any(|ratio| (ratio - 1.0).abs() > VISIBLE);
        let is_lit = all.iter().all(|&ratio| ratio >= DARKEST);
        (is_visible && is_lit).then(|| [red[n], green[n], blue[n]].map(|ratio| (1.0 / ratio) as f32))
    };
    (0..slices.len().min(gains.len())).map(of_slice).collect()
}

/// Per slice: its brightness over the expected one; 1 where that is unknown. In a stack too short for [`ratios`] only a
/// slice counts that differs from all others, which agree; of two slices the reference slice is right.
fn deviations(brightness: &[Option<f64>], reference: usize) -> Vec<f64> {
    let known = brightness.iter().flatten().count();
    if known > FEWEST {
        return ratios(brightness).into_iter().map(|ratio| ratio.unwrap_or(1.0)).collect();
    }
    let alone = |(n, own): (usize, &Option<f64>)| {
        let others = brightness.iter().enumerate().filter(|&(other, _)| other != n);
        let mut others: Vec<f64> = others.filter_map(|(_, &value)| value).collect();
        let ratio = (*own)? / median_midpoint(&mut others)?;
        let (least, most) = others.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &v| (a.min(v), b.max(v)));
        let differs = most / least - 1.0 < AGREED * (ratio - 1.0).abs() && !(known == 2 && n == reference);
        differs.then_some(ratio)
    };
    brightness.iter().enumerate().map(|of| alone(of).unwrap_or(1.0)).collect()
}

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
    fn one_slice_that_differs_is_corrected_in_stacks_of_any_length_and_a_drift_is_not() {
        for count in 2..12 {
            for (odd, by) in (0..count).flat_map(|odd| [1.3, 0.7].map(|by| (odd, by))) {
                let reference = if count == 2 { 1 - odd } else { count / 2 };
                let stack: Vec<Option<f64>> = (0..count).map(|n| Some(if n == odd { by } else { 1.0 })).collect();
                let found = deviations(&stack, reference);
                let right = |(n, ratio): (usize, &f64)| (ratio - if n == odd { by } else { 1.0 }).abs() < 1e-9;
                assert!(found.iter().enumerate().all(right), "{odd} of {count}: {found:?}");
            }
            let drift: Vec<Option<f64>> = (0..count).map(|n| Some(1.0 + 0.1 * n as f64)).collect();
            let found = deviations(&drift, count / 2);
            assert!(count == 2 || found.iter().all(|ratio| (ratio - 1.0).abs() < 1e-9), "{count}: {found:?}");
        }
        assert_eq!(deviations(&[Some(1.0), None, Some(1.3)], 0), [1.0, 1.0, 1.3]);
        assert_eq!(deviations(&[], 0), [0.0; 0]);
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
