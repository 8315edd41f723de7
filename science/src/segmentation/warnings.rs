//! Warnings about a silhouette.

use super::translucent::Translucent;
use crate::types::{Warning, WarningCode, metrics::MaskMetrics};

/// Separability below which there are hardly two classes of pixels.
const DOUBTFUL_SEPARABILITY: f64 = 0.75;
/// Share of the picture from which a mask counts as full.
const FULL: f64 = 0.999;
/// Share of the border from which the object is probably the background.
const INVERTED_BORDER: f64 = 0.5;
/// Falloff of the illumination above which little contrast is left in dim places.
const MAX_FALLOFF: f64 = 0.7;

/// What the removal of small parts did.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cleaning {
    /// The option `mask_min_blob_px`: parts with fewer pixels were removed.
    pub min_blob_px: u32,
    /// Number of the parts that were removed.
    pub removed_parts: u32,
}

/// The warnings that follow from the metrics of a mask and from its translucent parts. `fixed_threshold`: the option
/// `mask_threshold` was sent.
pub(super) fn of(
    metrics: &MaskMetrics,
    translucent: Option<&Translucent>,
    fixed_threshold: bool,
    cleaning: Cleaning,
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn = |code: WarningCode, detail: String| warnings.push(Warning::new(code, detail));
    let percent = 100.0 * metrics.threshold;
    let (is_empty, is_full) = (metrics.foreground_fraction == 0.0, metrics.foreground_fraction > FULL);
    if is_empty {
        warn(WarningCode::MaskEmpty, empty(percent, fixed_threshold, cleaning));
    }
    if is_full {
        let advice = if fixed_threshold { "omit mask_threshold or send a smaller value, and check" } else { "check" };
        warn(
            WarningCode::MaskFull,
            format!(
                "the mask is full: everything in the back light is darker than {percent:.1} % of full scale; {advice} \
                 that the back light was on and bright, and that the object is in the picture"
            ),
        );
    }
    if let Some(separability) = metrics.separability.filter(|_| !is_empty && !is_full)
        && separability < DOUBTFUL_SEPARABILITY
    {
        let (at_threshold, advice) = if fixed_threshold {
            (" at the mask_threshold that was sent", "omit mask_threshold, or make")
        } else {
            ("", "make")
        };
        warn(
            WarningCode::MaskLowSeparability,
            format!(
                "object and background hardly differ in the back light{at_threshold} (separability {separability:.2}; \
                 above 0.9 is good): {advice} the back light brighter, or shield the object from the front light"
            ),
        );
    }
    if let Some(falloff) = metrics.light_falloff.filter(|falloff| *falloff > MAX_FALLOFF) {
        warn(
            WarningCode::MaskUnevenLight,
            format!(
                "the back light falls off by {:.0} % from its brightest to its dimmest place; this was corrected, \
                 but in dim places the contrast to the object is low: centre the lamp, or put a diffuser farther \
                 from it",
                100.0 * falloff
            ),
        );
    }
    if let Some(translucent) = translucent {
        warn(
            WarningCode::MaskTranslucent,
            format!(
                "{:.0} % of the object is translucent (about {:.0} % of the back light passes through): such parts, \
                 for example wings, are counted as object; inspect the mask, and lower the exposure of the back \
                 light if they are ragged",
                100.0 * translucent.share,
                100.0 * translucent.transmittance
            ),
        );
    }
    let border = metrics.border_contact_fraction;
    if border > INVERTED_BORDER && !is_full {
        warn(
            WarningCode::MaskInverted,
            format!(
                "{:.0} % of the border of the picture is counted as object, but the background must be brighter than \
                 the object: check that these are the back-light slices",
                100.0 * border
            ),
        );
    } else if border > 0.0 && !is_full {
        let share = if border < 0.001 { "less than 0.1 %".to_owned() } else { format!("{:.1} %", 100.0 * border) };
        warn(
            WarningCode::MaskTouchesBorder,
            format!(
                "the object reaches {share} of the border of the picture and is cut off there: show all of it, or \
                 ignore this if only its pin reaches the border"
            ),
        );
    }
    warnings
}

/// The sentence for an empty mask: all parts were removed as too small, or nothing is dark.
fn empty(percent: f64, fixed_threshold: bool, cleaning: Cleaning) -> String {
    let Cleaning { min_blob_px, removed_parts } = cleaning;
    let check = "check that the object is in the picture and that the front light was off";
    if removed_parts > 0 {
        let parts = match removed_parts {
            1 => "the only dark part is".to_owned(),
            n => format!("all {n} dark parts are"),
        };
        return format!(
            "the mask is empty: {parts} smaller than mask_min_blob_px ({min_blob_px} px): send a smaller value, or \
             {check}"
        );
    }
    let advice = if fixed_threshold { "omit mask_threshold or send a larger value, and " } else { "" };
    format!("the mask is empty: nothing in the back light is darker than {percent:.1} % of full scale; {advice}{check}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Metrics without a fault.
    fn good() -> MaskMetrics {
        MaskMetrics { foreground_fraction: 0.2, threshold: 0.4, separability: Some(0.95), ..MaskMetrics::default() }
    }

    fn warnings(metrics: &MaskMetrics, fixed_threshold: bool, removed_parts: u32) -> Vec<(String, String)> {
        let cleaning = Cleaning { min_blob_px: 12, removed_parts };
        let found = of(metrics, None, fixed_threshold, cleaning).into_iter();
        found.map(|warning| (warning.code.to_string(), warning.detail)).collect()
    }

    /// The sentence of the only warning, which must have this code.
    fn only(code: &str, metrics: &MaskMetrics, fixed_threshold: bool, removed_parts: u32) -> String {
        let found = warnings(metrics, fixed_threshold, removed_parts);
        assert!(found.len() == 1 && found[0].0 == code, "{code}: {found:?}");
        found[0].1.clone()
    }

    #[test]
    fn an_empty_mask_is_explained_by_its_cause() {
        let empty = MaskMetrics { foreground_fraction: 0.0, separability: Some(0.1), ..good() };
        let dark = only("mask_empty", &empty, false, 0);
        assert!(dark.contains("nothing in the back light is darker") && !dark.contains("mask_threshold"), "{dark}");
        let fixed = only("mask_empty", &empty, true, 0);
        assert!(fixed.contains("omit mask_threshold or send a larger value"), "{fixed}");
        for (parts, says) in [(1, "the only dark part is"), (7, "all 7 dark parts are")] {
            let removed = only("mask_empty", &empty, true, parts);
            let says = format!("{says} smaller than mask_min_blob_px (12 px): send a smaller value");
            assert!(removed.contains(&says) && !removed.contains("nothing"), "{removed}");
        }
    }

    #[test]
    fn a_full_mask_mentions_the_threshold_only_if_it_was_sent() {
        let full = MaskMetrics { foreground_fraction: 1.0, separability: Some(0.1), ..good() };
        let full = MaskMetrics { border_contact_fraction: 1.0, ..full };
        let (found, fixed) = (only("mask_full", &full, false, 0), only("mask_full", &full, true, 0));
        assert!(found.contains("that the object is in the picture") && !found.contains("mask_threshold"), "{found}");
        assert!(fixed.contains("omit mask_threshold or send a smaller value"), "{fixed}");
    }

    #[test]
    fn a_low_separability_is_blamed_on_a_threshold_that_was_sent() {
        let low = MaskMetrics { separability: Some(0.5), ..good() };
        let (found, fixed) =
            (only("mask_low_separability", &low, false, 0), only("mask_low_separability", &low, true, 0));
        assert!(!found.contains("mask_threshold") && fixed.contains("omit mask_threshold, or make"), "{fixed}");
    }

    #[test]
    fn a_short_contact_with_the_border_is_not_printed_as_zero() {
        for (border, says) in [(0.0004, "reaches less than 0.1 % of"), (0.0123, "reaches 1.2 % of")] {
            let metrics = MaskMetrics { border_contact_fraction: border, ..good() };
            let found = only("mask_touches_border", &metrics, false, 0);
            assert!(found.contains(says), "{found}");
        }
        assert_eq!(warnings(&good(), false, 3), []);
    }
}
