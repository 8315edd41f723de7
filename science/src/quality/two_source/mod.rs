//! The published metrics for a fusion of two sources, for comparison with published tables.
//!
//! Only tests use them: summed over many sources they rank a blurred image above the ideal one, so a stack is scored by
//! [`super::score`]. Guided fusion is compared with the figures of its paper, and the scores of stacks with these.
//!
//! All functions take luma planes (0..255) of one size and return none if the sizes differ or the planes are too small
//! or too flat. Published figures are for whole grey levels: round the luma of 8-bit images first (this changes Q_G by
//! 0.001).

mod viff;

pub(crate) use viff::viff;

use super::{
    piella::{self, WindowPair, moments},
    score::same_shape,
    xydeas,
};
use crate::imaging::Plane;

/// Q^{AB/F} of Xydeas and Petrovic (2000): gradient preservation, weighted by the gradients of the sources.
/// Upper bound [`xydeas::UPPER_BOUND`].
pub(crate) fn q_g(a: &Plane<f32>, b: &Plane<f32>, fused: &Plane<f32>) -> Option<f64> {
    if !same_shape(a, fused) || !same_shape(b, fused) {
        return None;
    }
    let (mut kept, mut weights) = (0.0, 0.0);
    for y in 0..fused.height {
        for x in 0..fused.width {
            let of_fused = sobel(fused, x, y);
            for source in [a, b] {
                let gradient = sobel(source, x, y);
                let weight = f64::from(gradient.0.hypot(gradient.1));
                kept += weight * f64::from(xydeas::preservation(gradient, of_fused));
                weights += weight;
            }
        }
    }
    ratio(kept, weights)
}

/// Q_W of Piella and Heijmans (2003) in 8x8 uniform windows: quality index, weighted by variance. At most 1.
pub(crate) fn q_w(a: &Plane<f32>, b: &Plane<f32>, fused: &Plane<f32>) -> Option<f64> {
    let sources = [moments(a, fused)?, moments(b, fused)?];
    let (mut quality, mut weights) = (0.0, 0.0);
    for (a, b) in sources[0].iter().zip(&sources[1]) {
        let both = a.source.variance + b.source.variance;
        let share = if both > 0.0 { a.source.variance / both } else { 0.5 };
        let index = |window: &WindowPair| piella::index(window.source, window.fused, window.covariance);
        let weight = a.source.variance.max(b.source.variance);
        quality += weight * (share * index(a) + (1.0 - share) * index(b));
        weights += weight;
    }
    ratio(quality, weights)
}

/// Q_E of Piella and Heijmans (2003): Q_W of the images times Q_W of their edge images (Prewitt).
pub(crate) fn q_e(a: &Plane<f32>, b: &Plane<f32>, fused: &Plane<f32>) -> Option<f64> {
    Some(q_w(a, b, fused)? * q_w(&edges(a), &edges(b), &edges(fused))?)
}

/// Spatial frequency: `sqrt(s / n)`, with `s` the sum of the squared differences to the right and lower neighbours and
/// `n` the number of pixels.
pub(crate) fn spatial_frequency(picture: &Plane<f32>) -> Option<f64> {
    let [right, below] = squared_differences(picture);
    ratio(right + below, picture.data.len() as f64).map(f64::sqrt)
}

/// Average gradient: mean of `sqrt((dx^2 + dy^2) / 2)` over the differences to the right and lower neighbours.
pub(crate) fn average_gradient(picture: &Plane<f32>) -> Option<f64> {
    let (width, height) = (picture.width.saturating_sub(1), picture.height.saturating_sub(1));
    let mut sum = 0.0;
    for y in 0..height {
        for x in 0..width {
            let right = f64::from(picture.at(x + 1, y) - picture.at(x, y));
            let below = f64::from(picture.at(x, y + 1) - picture.at(x, y));
            sum += ((right * right + below * below) / 2.0).sqrt();
        }
    }
    ratio(sum, (width * height) as f64)
}

/// Variance of the 4-neighbour Laplacian over the inner pixels.
pub(crate) fn laplacian_variance(picture: &Plane<f32>) -> Option<f64> {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for y in 1..picture.height.saturating_sub(1) {
        for x in 1..picture.width.saturating_sub(1) {
            let around = picture.at(x - 1, y) + picture.at(x + 1, y) + picture.at(x, y - 1) + picture.at(x, y + 1);
            let value = f64::from(around - 4.0 * picture.at(x, y));
            sum += value;
            squares += value * value;
            count += 1.0;
        }
    }
    let mean = ratio(sum, count)?;
    Some((squares / count - mean * mean).max(0.0))
}

fn ratio(above: f64, below: f64) -> Option<f64> {
    (below > 0.0).then(|| above / below).filter(|ratio| ratio.is_finite())
}

fn squared_differences(picture: &Plane<f32>) -> [f64; 2] {
    let (mut right, mut below) = (0.0, 0.0);
    for y in 0..picture.height {
        for x in 0..picture.width {
            let here = picture.at(x, y);
            if x + 1 < picture.width {
                right += f64::from(picture.at(x + 1, y) - here).powi(2);
            }
            if y + 1 < picture.height {
                below += f64::from(picture.at(x, y + 1) - here).powi(2);
            }
        }
    }
    [right, below]
}

/// The sample at (x + dx - 1, y + dy - 1), zero outside, as the published code pads.
fn padded(picture: &Plane<f32>, x: usize, y: usize, dx: usize, dy: usize) -> f32 {
    let inside = |v: usize, d: usize, end: usize| (v + d).checked_sub(1).filter(|&v| v < end);
    match (inside(x, dx, picture.width), inside(y, dy, picture.height)) {
        (Some(x), Some(y)) => picture.at(x, y),
        _ => 0.0,
    }
}

/// The 3x3 kernels along x and along y with `middle` 2 (Sobel) or 1 (Prewitt).
fn gradient(picture: &Plane<f32>, x: usize, y: usize, middle: f32) -> (f32, f32) {
    let at = |dx, dy| padded(picture, x, y, dx, dy);
    let weights = [1.0, middle, 1.0];
    let gx = (0..3).map(|k| weights[k] * (at(2, k) - at(0, k))).sum();
    let gy = (0..3).map(|k| weights[k] * (at(k, 2) - at(k, 0))).sum();
    (gx, gy)
}

fn sobel(picture: &Plane<f32>, x: usize, y: usize) -> (f32, f32) {
    gradient(picture, x, y, 2.0)
}

fn edges(picture: &Plane<f32>) -> Plane<f32> {
    Plane::from_fn(picture.width, picture.height, |x, y| {
        let (gx, gy) = gradient(picture, x, y, 1.0);
        gx.hypot(gy)
    })
}

pub(crate) mod tests;
