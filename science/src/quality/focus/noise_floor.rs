//! Noise floor: the saliency above which a pixel is textured.

use crate::imaging::statistics;

/// The floor is this many times the saliency of noise: about six standard deviations of smoothed noise above its mean.
pub(super) const MARGIN: f32 = 2.0;
/// Quantile of all values that is taken as the saliency of noise.
const QUIET: f64 = 0.1;
/// Smaller values are not noise but clipped black or white, and are ignored.
const DEAD: f32 = 0.05;
/// Least floor: rounding to 8 bits alone has about this saliency.
const LOWEST: f32 = 1.0;
/// Largest floor: an image without quiet pixels must not pass for noise. 12 is the floor of noise of 2 grey levels.
const HIGHEST: f32 = 12.0;

/// The noise floor of `saliency` (of luma 0..255), the values of all samples in all slices.
///
/// In most slices a pixel is out of focus and shows noise alone. So the lowest tenth of all samples in all slices is
/// noise, even if the object is textured everywhere. (The quietest pixels, by their sharpest slice, would not do: a
/// textured object has none, and on a plain background they are only the lower tail of the noise.)
pub(super) fn measure(saliency: &[f32]) -> f32 {
    let mut alive: Vec<f32> = saliency.iter().copied().filter(|&value| value > DEAD).collect();
    let quiet = statistics::quantile_nearest(&mut alive, QUIET).unwrap_or(0.0);
    (MARGIN * quiet).clamp(LOWEST, HIGHEST)
}
