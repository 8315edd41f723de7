//! How far the results are from the truth.

use pinstack_science::{
    imaging::{Plane, Raster, Samples},
    types::Homography,
};

/// The largest distance in px, over all slices, between where the measured and the true homographies send the image's corners.
pub(super) fn worst_corner_px(measured: &[Homography], truth: &[Homography], width: u32, height: u32) -> f64 {
    measured.iter().zip(truth).map(|(m, t)| m.corner_distance(t, width, height)).fold(0.0, f64::max)
}

/// Peak signal-to-noise ratio in dB of the colours of `picture` against `truth`, where `inside` is not 0. 8 bits.
pub(super) fn psnr(picture: &Raster, truth: &Raster, inside: &Plane<u8>) -> f64 {
    let (Samples::Eight(a), Samples::Eight(b)) = (&picture.samples, &truth.samples) else { return f64::NAN };
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, _) in inside.data.iter().enumerate().filter(|(_, inside)| **inside != 0) {
        for c in 0..3 {
            let difference = f64::from(a[i * picture.channels + c]) - f64::from(b[i * truth.channels + c]);
            sum += difference * difference;
            count += 1.0;
        }
    }
    10.0 * (255.0 * 255.0 / (sum / count)).log10()
}

/// Intersection over union of two masks.
pub(super) fn iou(a: &[u8], b: &[u8]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a > 127 && **b > 127).count();
    let any = a.iter().zip(b).filter(|(a, b)| **a > 127 || **b > 127).count();
    both as f64 / any.max(1) as f64
}
