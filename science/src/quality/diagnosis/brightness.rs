//! Findings on brightness and colour: `exposure_flicker`, `exposure_drift`, `white_balance_drift`.

use super::{Diagnoser, warning};
use crate::types::metrics::Finding;

/// Flicker: brightness differs from that of the surrounding slices by more than this share.
const FLICKER: f64 = 0.03;
/// Drift: brightness after the gains differs from that of the reference slice by more than this share. From here on a
/// step of brightness becomes visible where two slices meet.
const DRIFT: f64 = 0.03;
/// Drift of red over green, or of blue over green.
const BALANCE: f64 = 0.03;

impl Diagnoser<'_> {
    pub(super) fn brightness(&self) -> Vec<Finding> {
        let slices = &self.quality.slices;
        let mut findings = Vec::new();
        let deviation = |ratio: Option<f64>| ratio.map_or(0.0, |ratio| ratio - 1.0);
        let largest = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
        let flickering: Vec<u32> = slices
            .iter()
            .filter(|slice| deviation(slice.flicker_ratio).abs() > FLICKER)
            .map(|slice| slice.index)
            .collect();
        if !flickering.is_empty() {
            let most = slices.iter().map(|slice| deviation(slice.flicker_ratio)).fold(0.0, largest);
            let detail = format!(
                "the brightness of {} differs from that of the slices around by up to {:+.0} %: the light or the shutter \
                 flickers; use constant light, manual exposure and a fixed aperture",
                self.named(&flickering),
                100.0 * most
            );
            findings.push(warning("exposure_flicker", flickering.clone(), detail));
        }
        let steady = |n: &usize| !flickering.contains(&(*n as u32));
        let equalised = (0..self.evidence.equalised.len()).filter(steady).filter_map(|n| self.evidence.equalised[n]);
        let drift = equalised.map(|ratio| ratio - 1.0).fold(0.0, largest);
        if drift.abs() > DRIFT && slices.len() > 2 {
            let detail = format!(
                "after the gains of the profile the brightness still differs from that of the reference slice by up to \
                 {:+.0} %: let the lamps warm up, then calibrate again so that the gains fit",
                100.0 * drift
            );
            findings.push(warning("exposure_drift", Vec::new(), detail));
        }
        let drifts = |slice: &u32| {
            slices[*slice as usize].balance_ratio.is_some_and(|b| b.iter().any(|r| (r - 1.0).abs() > BALANCE))
        };
        let drifting: Vec<u32> = (0..slices.len() as u32).filter(drifts).collect();
        if !drifting.is_empty() {
            let detail = format!(
                "the colour of {} differs from that of the reference slice by more than {:.0} %: set the white balance by \
                 hand, and let the lamps warm up",
                self.named(&drifting),
                100.0 * BALANCE
            );
            findings.push(warning("white_balance_drift", drifting, detail));
        }
        findings
    }
}
