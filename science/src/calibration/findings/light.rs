//! Findings about the light: exposure, tint, stripes, and how certain the gains are.

use super::facts::Facts;
use crate::calibration::gains::{self, MAX_SIGMA};
use crate::calibration::{banding, grade::Finding, statistics::quantile};
use crate::types::{WarningCode, report::Grade};

/// Share of the pixels at full scale from which a slice is named.
const CLIPPED: f64 = 0.05;
/// Relative uncertainty of a gain beyond which a calibration is not good.
const POOR_GAIN: f64 = 0.01;
/// Light of the darkest part of the target over that of the brightest from which it is named.
const UNEVEN: f64 = 0.4;
/// Relative deviation of the brightness or tint of a slice from which it is named.
const OUTLIER: f64 = 0.01;

/// The findings about the light.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let all = [
        clipped_white(facts),
        exposure(facts),
        tints(facts),
        lamp_banding(facts),
        uneven(facts),
        uncertain_gains(facts),
    ];
    all.into_iter().flatten().collect()
}

fn clipped_white(facts: &Facts) -> Option<Finding> {
    let names = facts.names_where(|i| facts.detection(i).is_some_and(|s| s.clipped > CLIPPED))?;
    let detail =
        format!("the white of the target is clipped in {names}: their gains are unreliable; reduce the exposure");
    Some(Finding::remark(WarningCode::ClippedWhite, detail))
}

fn uncertain_gains(facts: &Facts) -> Option<Finding> {
    let sigma = |i: usize| facts.solution.slices[i].gain.sigma;
    let unsure = facts.slices_where(|i| sigma(i) > MAX_SIGMA);
    if unsure.is_empty() {
        return None;
    }
    let worst = unsure.iter().map(|&i| sigma(i)).fold(0.0, f64::max);
    let by = if worst < 0.5 { format!("by {:.1} %", 100.0 * worst) } else { "by 50 % or more".to_owned() };
    let detail = format!(
        "the gains are uncertain {by} in {}: use dark dots on white, evenly lit and not clipped, in raw or linear \
         images",
        facts.names(&unsure)
    );
    let allows = if worst > POOR_GAIN { Grade::Usable } else { Grade::Good };
    Some(Finding::limiting(allows, WarningCode::UncertainGains, detail))
}

/// Slices with another exposure than the gain model expects. Their gains make up for it.
fn exposure(facts: &Facts) -> Option<Finding> {
    let off = |i: usize| facts.solution.slices[i].gain.off_model.filter(|off| (off - 1.0).abs() > OUTLIER);
    let slices = facts.listed_where(off, |name, off| {
        let percent = 100.0 * (off - 1.0);
        format!("{name} ({:.1} % {})", percent.abs(), if percent < 0.0 { "darker" } else { "brighter" })
    })?;
    let detail = format!(
        "the exposure differs from what the other slices lead to expect in {slices}: the gains make up for it, but every \
         stack taken with a steady lamp will then be wrong by as much; check the lamp, the flash and the exposure time, \
         and calibrate again"
    );
    Some(Finding::remark(WarningCode::ExposureOutlier, detail))
}

/// Slices with another tint than the others.
fn tints(facts: &Facts) -> Option<Finding> {
    let tints: Vec<Option<[f64; 2]>> =
        facts.tracked.detections.iter().map(|d| d.as_ref().and_then(|d| d.tint)).collect();
    let off = gains::off_tint(&tints, &facts.solution.rail.positions);
    let large = |i: usize| off[i].filter(|o| o.iter().any(|t| t.abs() > OUTLIER));
    let slices = facts.listed_where(large, |name, off| {
        let percent = off.map(|t| 100.0 * (t.exp() - 1.0));
        format!("{name} (red {:+.1} %, blue {:+.1} %)", percent[0], percent[1])
    })?;
    let detail = format!(
        "the tint differs from that of the other slices in {slices}: set a fixed white balance, and calibrate again"
    );
    Some(Finding::limiting(Grade::Usable, WarningCode::TintOutlier, detail))
}

/// That one side of the target has much less light than the other.
fn uneven(facts: &Facts) -> Option<Finding> {
    let mut light: Vec<f64> = facts.base()?.dots.values().filter_map(|dot| dot.light.linear_mean).collect();
    let share = quantile(&mut light, 0.02) / quantile(&mut light, 0.98);
    let detail = format!(
        "the target is lit unevenly: its darkest part has {:.0} % of the light of the brightest, which displaces blurred \
         dots; light it from both sides",
        100.0 * share
    );
    (share < UNEVEN).then(|| Finding::remark(WarningCode::UnevenLight, detail))
}

/// Slices with stripes of light.
fn lamp_banding(facts: &Facts) -> Option<Finding> {
    let ripples: Vec<_> = facts.tracked.detections.iter().map(|d| d.as_ref().and_then(|d| d.ripple)).collect();
    let stripes = banding::stripes(&ripples);
    let slices = facts.listed_where(|i| stripes[i], |name, share| format!("{name} ({:.1} %)", 100.0 * share))?;
    let detail = format!(
        "stripes of light cross {slices}: the lamp flickers while the shutter runs, which displaces the dots and makes \
         stacks uneven; use a lamp on direct current, a longer exposure, or the mechanical shutter"
    );
    Some(Finding::limiting(Grade::Usable, WarningCode::LampBanding, detail))
}
