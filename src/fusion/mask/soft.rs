//! A soft edge: how much of each pixel is object.

use super::{components::reached, tones::Tones};
use crate::imaging::Plane;

/// Less cover than this is the rest of a veil, or noise; as near to full cover it is full.
pub(super) const LEAST: f32 = 0.15;

/// Alpha by cover: of the object `alpha` (0 or 255) and of what hangs on it and is only just darker than the background,
/// as the tip of a hair. Where `alpha` is 255 it is at least 128, elsewhere at most 127; what was filled is full.
pub(super) fn edge(grey: &[f32], alpha: &Plane<u8>, is_valid: impl Fn(usize) -> bool, tones: &Tones) -> Plane<u8> {
    let cover = |at: usize| tones.cover(grey[at]);
    let is_faint = |at: usize| is_valid(at) && (LEAST..0.5).contains(&cover(at));
    let faint = reached(alpha, is_faint);
    let value = |at: usize| match (alpha.data[at] != 0, cover(at)) {
        (true, cover) if !(0.5..=1.0 - LEAST).contains(&cover) => 255,
        (true, cover) => ((255.0 * cover).round() as u8).max(128),
        (false, cover) if faint[at] => ((255.0 * cover).round() as u8).min(127),
        (false, _) => 0,
    };
    Plane { width: alpha.width, height: alpha.height, data: (0..grey.len()).map(value).collect() }
}
