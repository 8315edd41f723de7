//! Findings on the fused image as a whole: `clipped`, `halos`, `unfocused_area`, `small_common_area`, `little_texture`.

use super::{Diagnoser, StackQuality, note, warning};
use crate::types::{WarningCode, metrics::Finding};

/// Share of the fused image at full scale or at zero.
const CLIPPED: f64 = 0.005;
/// Mean overshoot beyond the range of the slices, grey levels.
const HALO_LEVELS: f64 = 1.0;
/// Share of the object in one unfocused area.
const UNFOCUSED: f64 = 0.25;
/// Share of the canvas that every slice covers.
const COMMON: f64 = 0.9;
/// Share of textured pixels below which the other numbers rest on little.
const TEXTURED: f64 = 0.01;

impl Diagnoser<'_> {
    /// Whether the metrics of focus and alignment rest on almost nothing.
    pub(super) fn has_little_texture(&self) -> bool {
        self.quality.focus.textured_fraction.is_some_and(|fraction| fraction < TEXTURED)
    }

    pub(super) fn image(&self) -> Vec<Finding> {
        let StackQuality { fusion, focus, alignment, .. } = self.quality;
        let mut findings = Vec::new();
        let percent = |fraction: f64| 100.0 * fraction;
        let whole = if self.evidence.masked { "object" } else { "image" };
        if let Some(fraction) = fusion.clipped_fraction.filter(|fraction| *fraction > CLIPPED) {
            let background =
                if self.evidence.masked { "" } else { " (a background that is black on purpose counts too)" };
            let detail = format!(
                "{:.1} % of the {whole} is at full scale or black{background}, and detail there is lost; change \
                 the exposure, or soften the light",
                percent(fraction)
            );
            findings.push(warning(WarningCode::Clipped, Vec::new(), detail));
        }
        if let Some(levels) = fusion.overshoot_levels.filter(|levels| *levels > HALO_LEVELS) {
            let detail = format!(
                "the fused image exceeds the range of the slices by {levels:.1} grey levels on average; look for halos at \
                 edges, and try smaller filters"
            );
            findings.push(note(WarningCode::Halos, Vec::new(), detail));
        }
        if let Some(area) = focus.unfocused_area.filter(|area| area.fraction > UNFOCUSED) {
            let detail = format!(
                "one connected area with {:.0} % of the object ({} x {} px at {}, {} of the canvas) has no texture in \
                 any slice: it is smooth, or never in focus; check whether the stack reaches it",
                percent(area.fraction),
                area.width,
                area.height,
                area.x,
                area.y
            );
            findings.push(note(WarningCode::UnfocusedArea, Vec::new(), detail));
        }
        if let Some(fraction) = alignment.common_fraction.filter(|fraction| *fraction < COMMON) {
            let detail = format!(
                "only {:.0} % of the canvas is covered by every slice, so fewer slices are available near the border, \
                 which crop=valid cuts off; keep the object in the middle",
                percent(fraction)
            );
            findings.push(note(WarningCode::SmallCommonArea, Vec::new(), detail));
        }
        if let Some(fraction) = focus.textured_fraction.filter(|_| self.has_little_texture()) {
            let detail = format!(
                "only {:.2} % of the {whole} has texture; do not rely on the metrics of focus and alignment",
                percent(fraction)
            );
            findings.push(note(WarningCode::LittleTexture, Vec::new(), detail));
        }
        findings
    }
}
