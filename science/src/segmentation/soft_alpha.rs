//! Soft alpha: the share of each pixel that the object covers.
//!
//! | pixel | alpha |
//! |---|---|
//! | in the mask, half covered, connected to the outside by half covered pixels | `255 cover`, at least 128 |
//! | any other pixel of the mask | 255 |
//! | outside, faintly covered, connected to the mask by such pixels | `255 cover`, at most 127 |
//! | any other pixel outside | 0 |
//!
//! The first row leaves reflections and noise on the object opaque: there is no path to them from outside. The third
//! keeps the tips of hairs that are too fine for the mask. Translucent parts are opaque too: light passes through them,
//! but they cover what is behind them.

use super::{components::reachable, tones::Tones, translucent::Translucent};
use crate::imaging::Plane;

/// Least cover that counts: below it is noise, or the remainder of defocused edges. From `1 - MIN_COVER` on a pixel is
/// opaque.
pub(super) const MIN_COVER: f32 = 0.15;

/// The soft alpha of a `mask` of 0 and 255, by the cover of the values `grey` and the `translucent` parts.
pub(super) fn soft_alpha(
    grey: &[f32],
    mask: &Plane<u8>,
    translucent: Option<&Translucent>,
    is_valid: impl Fn(usize) -> bool,
    tones: &Tones,
) -> Plane<u8> {
    let cover = |at: usize| tones.cover(grey[at]);
    let is_faint = |at: usize| is_valid(at) && (MIN_COVER..0.5).contains(&cover(at));
    let faint = reachable(mask, is_faint);
    let outside = Plane { data: mask.data.iter().map(|&v| 255 - v).collect(), ..*mask };
    let is_translucent = |at: usize| translucent.is_some_and(|translucent| translucent.pixels[at]);
    let half = reachable(&outside, |at| (0.5..=1.0 - MIN_COVER).contains(&cover(at)) && !is_translucent(at));
    let value = |at: usize| match mask.data[at] != 0 {
        true if half[at] => ((255.0 * cover(at)).round() as u8).max(128),
        true => 255,
        false if faint[at] => ((255.0 * cover(at)).round() as u8).min(127),
        false => 0,
    };
    Plane { width: mask.width, height: mask.height, data: (0..grey.len()).map(value).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_edge_of_the_object_is_soft_and_reflections_are_opaque() {
        let (width, height) = (40, 30);
        let tones = Tones { dark: 0.0, threshold: 0.5, bright: 1.0, separability: None, one_class: false };
        let grey: Vec<f32> = (0..width * height)
            .map(|at| match (at % width, at / width) {
                // a reflection, and a grain of noise
                (14..=20, 12..=16) | (25, 20) => 0.4,
                // a wing
                (33..=36, 8..=20) => 0.45,
                (10..=32, 8..=22) => 0.0,
                (9, 8..=22) => 0.3,
                (8, 8..=22) => 0.7,
                _ => 1.0,
            })
            .collect();
        let mask = Plane { width, height, data: grey.iter().map(|&v| if v < 0.5 { 255 } else { 0 }).collect() };
        let pixels: Vec<bool> = grey.iter().map(|&v| v == 0.45).collect();
        let translucent = Translucent { pixels, share: 0.1, transmittance: 0.45 };
        let soft = soft_alpha(&grey, &mask, Some(&translucent), |_| true, &tones);
        let row: Vec<u8> =
            [7, 8, 9, 10, 16, 25, 34, 36, 37].map(|x| soft.at(x, if x == 25 { 20 } else { 14 })).to_vec();
        assert_eq!(row, [0, 77, 179, 255, 255, 255, 255, 255, 0]);
    }
}
