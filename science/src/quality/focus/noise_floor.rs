//! How much saliency noise alone makes.

use crate::quality::statistics;

/// The floor lies this much over what the quietest tenth shows: about six deviations of smoothed noise.
pub(super) const MARGIN: f32 = 2.0;
/// The part of all values that is taken for noise.
const QUIET: f64 = 0.1;
/// Values under this are no noise but clipped black or white.
const DEAD: f32 = 0.05;
/// Rounding to 8 bits alone makes about this much.
const LOWEST: f32 = 1.0;
/// A picture without any quiet pixel must not pass for noise: saliency 12 is noise of 2 levels, with margin.
const HIGHEST: f32 = 12.0;

/// The saliency (of luma 0..255) above which there is texture.
///
/// In most slices a pixel is out of focus and shows noise alone; so the quietest tenth of all samples in all
/// slices is noise, also when the object is textured all over. (Looking for the quietest pixels instead, by
/// their sharpest slice, finds none there, and on a plain background finds only the lower tail of the noise.)
pub(super) fn measure(saliency: &[f32]) -> f32 {
    let mut alive: Vec<f32> = saliency.iter().copied().filter(|&value| value > DEAD).collect();
    let quiet = statistics::nth(&mut alive, QUIET).unwrap_or(0.0);
    (MARGIN * quiet).clamp(LOWEST, HIGHEST)
}
