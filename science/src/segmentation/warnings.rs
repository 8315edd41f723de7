//! What looks wrong with a silhouette, in sentences.

use super::translucent::Thin;
use crate::types::{Warning, metrics::MaskMetrics};

/// Below this share of explained variance there are hardly two kinds of pixels.
const DOUBTFUL_SEPARABILITY: f64 = 0.75;
/// An object that takes so much of the border is probably the background.
const INVERTED_BORDER: f64 = 0.5;
/// A light that loses more than this from place to place leaves little to tell the object from where it is dim.
const UNEVEN: f64 = 0.7;

pub(super) fn of(metrics: &MaskMetrics, thin: Option<&Thin>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn = |code: &str, detail: String| warnings.push(Warning::new(code, detail));
    let percent = 100.0 * metrics.threshold;
    if metrics.foreground_fraction == 0.0 {
        warn(
            "mask_empty",
            format!(
                "nothing is darker than {percent:.1} % of full scale in the back light: the mask is empty; look whether the \
                 object stands in the picture and the front light was off"
            ),
        );
    }
    if metrics.foreground_fraction > 0.999 {
        warn(
            "mask_full",
            format!(
                "everything is darker than {percent:.1} % of full scale, so that the mask is full: was the back light on?"
            ),
        );
    }
    if let Some(separability) = metrics.separability
        && separability < DOUBTFUL_SEPARABILITY
    {
        warn(
            "mask_low_separability",
            format!(
                "object and background of the back light hardly differ (separability {separability:.2}, good is above \
                 0.9): raise the back light or shield the object from the front light"
            ),
        );
    }
    if let Some(falloff) = metrics.light_falloff.filter(|falloff| *falloff > UNEVEN) {
        warn(
            "mask_uneven_light",
            format!(
                "the back light loses {:.0} % from its brightest to its dimmest place; that was evened out, but where it is \
                 dim little tells the object from it: move the lamp to the middle, or put a diffuser farther from it",
                100.0 * falloff
            ),
        );
    }
    if let Some(thin) = thin {
        warn(
            "mask_translucent",
            format!(
                "the back light shines through {:.0} % of the object (about {:.0} % of it passes there): thin parts, as wings, \
                 are counted as object; look at the mask, and lower the back light's exposure if they are ragged",
                100.0 * thin.share,
                100.0 * thin.passes
            ),
        );
    }
    let border = metrics.border_contact_fraction;
    if border > INVERTED_BORDER && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_inverted",
            format!(
                "{:.0} % of the border of the picture counts as object: the background must be brighter than the \
                 object, look whether these are the back-light slices",
                100.0 * border
            ),
        );
    } else if border > 0.0 && metrics.foreground_fraction <= 0.999 {
        warn(
            "mask_touches_border",
            format!("{:.1} % of the border of the picture is object: the object is cut off there", 100.0 * border),
        );
    }
    warnings
}
