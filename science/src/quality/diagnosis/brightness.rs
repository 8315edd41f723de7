//! Findings on brightness and colour: `exposure_flicker`, `exposure_drift`, `white_balance_drift`.
//!
//! All ratios are relative to the reference slice. If that slice alone is the faulty one, all others deviate; then the
//! comparison is with the median of the others.

use super::{Diagnoser, warning};
use crate::{
    imaging::statistics::median_midpoint,
    quality::flicker,
    types::{WarningCode, metrics::Finding},
};

/// Drift: brightness after the gains differs from that of the reference slice by more than this share. From here on a
/// step of brightness becomes visible where two slices meet.
const DRIFT: f64 = 0.03;
/// Drift of red over green, or of blue over green.
const BALANCE: f64 = 0.03;
/// The colour of the reference slice is at fault if at least two thirds of the other slices agree on another one, to
/// within this share.
const AGREED: f64 = 0.015;

impl Diagnoser<'_> {
    pub(super) fn brightness(&self) -> Vec<Finding> {
        let flickering = self.flickering();
        let findings = [self.flicker(&flickering), self.drift(&flickering), self.white_balance()];
        findings.into_iter().flatten().collect()
    }

    /// The slices whose brightness differs from that of the slices around.
    fn flickering(&self) -> Vec<u32> {
        let slices = self.quality.slices.iter();
        slices
            .filter(|slice| deviation(slice.flicker_ratio).abs() > flicker::VISIBLE)
            .map(|slice| slice.index)
            .collect()
    }

    fn flicker(&self, flickering: &[u32]) -> Option<Finding> {
        let most = self.quality.slices.iter().map(|slice| deviation(slice.flicker_ratio)).fold(0.0, larger);
        (!flickering.is_empty()).then(|| {
            let detail = format!(
                "the brightness of {} differs from that of the slices around by up to {:+.0} %: the light or the \
                 shutter flickers. Fusion scaled the samples to the slices around, but what was clipped is lost; use constant \
                 light, manual exposure and a fixed aperture",
                self.named(flickering),
                100.0 * most
            );
            warning(WarningCode::ExposureFlicker, flickering.to_vec(), detail)
        })
    }

    fn drift(&self, flickering: &[u32]) -> Option<Finding> {
        let count = self.quality.slices.len();
        let is_steady = |n: usize| !flickering.contains(&(n as u32));
        let steady = (0..self.evidence.equalised.len()).filter(|&n| is_steady(n));
        let mut steady: Vec<f64> = steady.filter_map(|n| self.evidence.equalised[n]).collect();
        let (usual, whose) = if is_steady(self.evidence.reference) {
            (1.0, "that of the reference slice")
        } else {
            (median_midpoint(&mut steady).filter(|&usual| usual > 0.0)?, "the median of the steady slices")
        };
        let drift = steady.iter().map(|ratio| ratio / usual - 1.0).fold(0.0, larger);
        (drift.abs() > DRIFT && count > 2).then(|| {
            let (brightness, advice) = if self.evidence.has_gains {
                ("after the gains of the profile the brightness still", "then calibrate again so that the gains fit")
            } else {
                ("the profile has no gains, and the brightness", "and calibrate, or add gains to the profile")
            };
            // without flicker ratios a flash is not told from a drift
            let flicker = match count {
                ..=flicker::FEWEST => " (if the light flickers instead, use constant light)",
                _ => "",
            };
            let detail = format!(
                "{brightness} differs from {whose} by up to {:+.0} %: let the lamps warm up, {advice}{flicker}",
                100.0 * drift
            );
            warning(WarningCode::ExposureDrift, Vec::new(), detail)
        })
    }

    fn white_balance(&self) -> Option<Finding> {
        let (usual, whose) = match self.balance_of_others() {
            Some(usual) => (usual, "the other slices"),
            None => ([1.0; 2], "the reference slice"),
        };
        let drifts = |balance: [f64; 2]| (0..2).any(|i| (balance[i] / usual[i] - 1.0).abs() > BALANCE);
        let slices = self.quality.slices.iter().filter(|slice| slice.balance_ratio.is_some_and(drifts));
        let drifting: Vec<u32> = slices.map(|slice| slice.index).collect();
        (!drifting.is_empty()).then(|| {
            let detail = format!(
                "the colour of {} differs from that of {whose} by more than {:.0} %: set the white balance by hand, \
                 and let the lamps warm up",
                self.named(&drifting),
                100.0 * BALANCE
            );
            warning(WarningCode::WhiteBalanceDrift, drifting, detail)
        })
    }

    /// The median colour of the slices beside the reference slice, if they agree on one from which it deviates.
    fn balance_of_others(&self) -> Option<[f64; 2]> {
        let others = self.quality.slices.iter().filter(|slice| slice.index as usize != self.evidence.reference);
        let others: Vec<[f64; 2]> = others.filter_map(|slice| slice.balance_ratio).collect();
        let median = |i: usize| median_midpoint(&mut others.iter().map(|balance| balance[i]).collect::<Vec<f64>>());
        let usual = [median(0)?, median(1)?];
        let deviates = usual.iter().any(|&usual| usual > 0.0 && (1.0 / usual - 1.0).abs() > BALANCE);
        let agrees = |balance: &&[f64; 2]| (0..2).all(|i| (balance[i] / usual[i] - 1.0).abs() <= AGREED);
        let agreeing = others.iter().filter(agrees).count();
        (deviates && others.len() > 1 && 3 * agreeing >= 2 * others.len()).then_some(usual)
    }
}

/// How far a ratio is from 1; 0 for an unknown one.
fn deviation(ratio: Option<f64>) -> f64 {
    ratio.map_or(0.0, |ratio| ratio - 1.0)
}

/// The number with the larger absolute value.
fn larger(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() { b } else { a }
}
