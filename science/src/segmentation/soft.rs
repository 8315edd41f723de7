//! A soft edge: how much of each pixel is object.

use super::{components::reached, tones::Tones, translucent::Thin};
use crate::imaging::Plane;

/// Less cover than this is the rest of a veil, or noise; as near to full cover it is full.
pub(super) const LEAST: f32 = 0.15;

/// Alpha by cover: of the object `alpha` (0 or 255) and of what hangs on it and is only just darker than the background,
/// as the tip of a hair. Where `alpha` is 255 it is at least 128, elsewhere at most 127.
///
/// Full is what no way over half covered pixels leads to from outside: noise and reflections on the object cover it no
/// less. Full are also `thin` parts, which cover what is behind them though light comes through.
pub(super) fn edge(
    grey: &[f32],
    alpha: &Plane<u8>,
    thin: Option<&Thin>,
    is_valid: impl Fn(usize) -> bool,
    tones: &Tones,
) -> Plane<u8> {
    let cover = |at: usize| tones.cover(grey[at]);
    let is_faint = |at: usize| is_valid(at) && (LEAST..0.5).contains(&cover(at));
    let faint = reached(alpha, is_faint);
    let outside = Plane { data: alpha.data.iter().map(|&v| 255 - v).collect(), ..*alpha };
    let is_thin = |at: usize| thin.is_some_and(|thin| thin.pixels[at]);
    let half = reached(&outside, |at| (0.5..=1.0 - LEAST).contains(&cover(at)) && !is_thin(at));
    let value = |at: usize| match alpha.data[at] != 0 {
        true if half[at] => ((255.0 * cover(at)).round() as u8).max(128),
        true => 255,
        false if faint[at] => ((255.0 * cover(at)).round() as u8).min(127),
        false => 0,
    };
    Plane { width: alpha.width, height: alpha.height, data: (0..grey.len()).map(value).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_rim_of_the_object_is_soft_whatever_shines_on_it() {
        let (width, height) = (40, 30);
        let tones = Tones { dark: 0.0, threshold: 0.5, bright: 1.0, separability: None };
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
        let alpha = Plane { width, height, data: grey.iter().map(|&v| if v < 0.5 { 255 } else { 0 }).collect() };
        let pixels: Vec<bool> = grey.iter().map(|&v| v == 0.45).collect();
        let thin = Thin { pixels, share: 0.1, passes: 0.45 };
        let soft = edge(&grey, &alpha, Some(&thin), |_| true, &tones);
        let row: Vec<u8> =
            [7, 8, 9, 10, 16, 25, 34, 36, 37].map(|x| soft.at(x, if x == 25 { 20 } else { 14 })).to_vec();
        assert_eq!(row, [0, 77, 179, 255, 255, 255, 255, 255, 0]);
    }
}
