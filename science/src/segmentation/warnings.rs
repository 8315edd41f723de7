//! Warnings about a silhouette.

use super::translucent::Translucent;
use crate::types::{Warning, metrics::MaskMetrics};

/// Separability below which there are hardly two classes of pixels.
const DOUBTFUL_SEPARABILITY: f64 = 0.75;
/// Share of the border from which the object is probably the background.
const INVERTED_BORDER: f64 = 0.5;
/// Falloff of the illumination above which little contrast is left in dim places.
const MAX_FALLOFF: f64 = 0.7;

/// The warnings that follow from the metrics of a mask and from its translucent parts.
pub(super) fn of(metrics: &MaskMetrics, thin: Option<&Translucent>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn = |code: &str, detail: String| warnings.push(Warning::new(code, detail));
    let percent = 100.0 * metrics.threshold;
    if metrics.foreground_fraction == 0.0 {
        warn(
            "mask_empty",
            format!(
                "the mask is empty: nothing in the back light is darker than {percent:.1} % of full scale; check \
                 that the object is in the picture and that the front light was off"
            ),
        );
    }
    if metrics.foreground_fraction > 0.999 {
        warn(
            "mask_full",
            format!(
                "the mask is full: everything in the back light is darker than {percent:.1} % of full scale; check \
                 that the back light was on"
            ),
        );
    }
    if let Some(separability) = metrics.separability
        && separability < DOUBTFUL_SEPARABILITY
    {
        warn(
            "mask_low_separability",
            format!(
                "object and background hardly differ in the back light (separability {separability:.2}; above 0.9 is \
                 good): make the back light brighter, or shield the object from the front light"
            ),
        );
    }
    if let Some(falloff) = metrics.light_falloff.filter(|falloff| *falloff > MAX_FALLOFF) {
        warn(
            "mask_uneven_light",
            format!(
                "the back light falls off by {:.0} % from its brightest to its dimmest place; this was corrected, \
                 but in dim places the contrast to the object is low: centre the lamp, or put a diffuser farther \
                 from it",
                100.0 * falloff
            ),
        );
    }
    if let Some(thin) = thin {
        warn(
            "mask_translucent",
            format!(
                "{:.0} % of the object is translucent (about {:.0} % of the back light passes through): such parts, \
                 for example wings, are counted as object; inspect the mask, and lower the exposure of the back \
                 light if they are ragged",
                100.0 * thin.share,
                100.0 * thin.transmittance
            ),
        );
    }
    let border = metrics.border_contact_fraction;
    if border > INVERTED_BORDER && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_inverted",
            format!(
                "{:.0} % of the border of the picture is counted as object, but the background must be brighter than \
                 the object: check that these are the back-light slices",
                100.0 * border
            ),
        );
    } else if border > 0.0 && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_touches_border",
            format!(
                "the object reaches {:.1} % of the border of the picture and is cut off there: show all of it, or \
                 ignore this if only its pin reaches the border",
                100.0 * border
            ),
        );
    }
    warnings
}
