//! Full-reference metrics: comparison with a known true image.
//!
//! The metrics of a stack do not use them, because a real stack has no truth. Users: the tests of fusion and the demo
//! command, which render stacks with a known truth.

use super::{
    piella::{SIDE, moments},
    score::{same_shape, whole_neighbourhoods},
};
use crate::imaging::Plane;

/// Peak signal-to-noise ratio of luma planes 0..255 over the non-zero pixels of `mask` (all without one), dB:
/// `10 log10(255^2 / mean((picture - truth)^2))`. Infinite for equal planes; none if sizes differ or no pixel counts.
///
/// ```
/// # use pinstack_science::{imaging::Plane, quality::full_reference::psnr};
/// let truth = Plane::from_fn(32, 24, |x, y| (5 * x + 3 * y) as f32);
/// let decibels = psnr(&truth.map(|level| level + 1.0), &truth, None).expect("planes of one size");
/// assert!((decibels - 48.13).abs() < 0.01);
/// ```
pub fn psnr(picture: &Plane<f32>, truth: &Plane<f32>, mask: Option<&Plane<u8>>) -> Option<f64> {
    if !same_shape(picture, truth) || mask.is_some_and(|mask| !same_shape(mask, truth)) {
        return None;
    }
    let (mut squares, mut count) = (0.0, 0u64);
    for (i, (&p, &t)) in picture.data.iter().zip(&truth.data).enumerate() {
        if mask.is_none_or(|mask| mask.data[i] != 0) {
            squares += f64::from(p - t).powi(2);
            count += 1;
        }
    }
    (count > 0).then(|| 10.0 * (255.0 * 255.0 * count as f64 / squares).log10())
}

/// Structural similarity (Wang et al., IEEE TIP 13(4), 2004) of luma planes 0..255: the mean over the 8x8 uniform
/// windows whose pixels all count. 1 for equal planes; none if sizes differ or no window counts.
pub fn ssim(picture: &Plane<f32>, truth: &Plane<f32>, mask: Option<&Plane<u8>>) -> Option<f64> {
    const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
    const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);
    let windows = moments(picture, truth)?;
    let whole = match mask {
        Some(mask) if same_shape(mask, truth) => Some(whole_neighbourhoods(mask, SIDE)),
        Some(_) => return None,
        None => None,
    };
    let (mut sum, mut count) = (0.0, 0u64);
    for (i, window) in windows.iter().enumerate() {
        if whole.as_ref().is_some_and(|whole| whole.data[i] == 0) {
            continue;
        }
        let (a, b) = (window.source, window.fused);
        let brightness = (2.0 * a.mean * b.mean + C1) / (a.mean * a.mean + b.mean * b.mean + C1);
        sum += brightness * (2.0 * window.covariance + C2) / (a.variance + b.variance + C2);
        count += 1;
    }
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern() -> Plane<f32> {
        Plane::from_fn(32, 24, |x, y| ((x * 7 + y * 13) % 61) as f32 * 4.0)
    }

    #[test]
    fn equal_pictures_have_infinite_psnr_and_similarity_1() {
        assert_eq!(psnr(&pattern(), &pattern(), None), Some(f64::INFINITY));
        assert!((ssim(&pattern(), &pattern(), None).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn only_pixels_of_the_mask_count() {
        let mask = Plane::from_fn(32, 24, |x, _| if x < 16 { 255u8 } else { 0 });
        let spoiled = Plane::from_fn(32, 24, |x, y| if x < 16 { pattern().at(x, y) } else { 0.0 });
        assert_eq!(psnr(&spoiled, &pattern(), Some(&mask)), Some(f64::INFINITY));
        assert!((ssim(&spoiled, &pattern(), Some(&mask)).unwrap() - 1.0).abs() < 1e-12);
        assert!(ssim(&spoiled, &pattern(), None).unwrap() < 0.7);
        assert_eq!(psnr(&spoiled, &pattern(), Some(&mask.map(|_| 0))), None);
    }

    #[test]
    fn pictures_of_different_size_are_not_compared() {
        let small = Plane::filled(8, 8, 0.0f32);
        assert_eq!(psnr(&small, &pattern(), None), None);
        assert_eq!(ssim(&small, &pattern(), None), None);
    }
}
