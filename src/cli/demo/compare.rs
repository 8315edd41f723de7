//! Measures that compare the results of the demo with the truth.

use pinstack_science::{
    imaging::{Plane, Raster, Samples},
    quality::full_reference,
    types::Homography,
};

/// Largest distance in px, over all slices and image corners, between the corner mapped by the measured and by the true
/// homography.
pub(super) fn worst_corner_px(measured: &[Homography], truth: &[Homography], width: u32, height: u32) -> f64 {
    measured.iter().zip(truth).map(|(m, t)| m.corner_distance(t, width, height)).fold(0.0, f64::max)
}

/// Peak signal-to-noise ratio, dB, of the red, green and blue samples of `picture` against `truth` where `inside` is
/// not 0. NaN where the pictures cannot be compared.
pub(super) fn psnr(picture: &Raster, truth: &Raster, inside: &Plane<u8>) -> f64 {
    let inside = Plane::from_fn(3 * inside.width, inside.height, |x, y| inside.at(x / 3, y));
    full_reference::psnr(&colour_samples(picture), &colour_samples(truth), Some(&inside)).unwrap_or(f64::NAN)
}

/// The red, green and blue samples of an 8-bit picture side by side; empty for other pictures.
fn colour_samples(picture: &Raster) -> Plane<f32> {
    match &picture.samples {
        Samples::Eight(samples) if picture.channels >= 3 => {
            let pixels = samples.chunks_exact(picture.channels);
            let data = pixels.flat_map(|pixel| pixel.iter().take(3).map(|&sample| f32::from(sample))).collect();
            Plane { width: 3 * picture.width, height: picture.height, data }
        }
        _ => Plane::filled(0, 0, 0.0),
    }
}

/// Intersection over union of two masks.
pub(super) fn iou(a: &[u8], b: &[u8]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a > 127 && **b > 127).count();
    let any = a.iter().zip(b).filter(|(a, b)| **a > 127 || **b > 127).count();
    both as f64 / any.max(1) as f64
}
