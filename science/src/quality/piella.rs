//! The universal image quality index of one window, as Piella & Heijmans (ICIP 2003) weight it.

/// Keeps flat windows from dividing by zero: (1e-6 * 255)^2.
pub const STABILISER: f64 = 2.55e-4 * 2.55e-4;

/// Mean (0..255) and population variance of one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Mean.
    pub mean: f64,
    /// Population variance.
    pub variance: f64,
}

/// The index of two windows with covariance `covariance`: 1 for equal windows, never beyond -1..1.
#[inline]
pub fn index(a: Moments, b: Moments, covariance: f64) -> f64 {
    // rounding may leave a flat window with a covariance that its variances do not allow
    let bound = (a.variance * b.variance).max(0.0).sqrt();
    let covariance = covariance.clamp(-bound, bound);
    let brightness = (2.0 * a.mean * b.mean + STABILISER) / (a.mean * a.mean + b.mean * b.mean + STABILISER);
    let structure = (2.0 * covariance + STABILISER) / (a.variance + b.variance + STABILISER);
    brightness * structure
}

/// [`index`] of (mean, variance) each, in single precision: for many windows at once.
#[inline(always)]
pub(super) fn index_of_many(a: (f32, f32), b: (f32, f32), covariance: f32) -> f32 {
    const LITTLE: f32 = STABILISER as f32;
    let bound = (a.1 * b.1).sqrt();
    let covariance = if covariance > bound { bound } else { covariance };
    let covariance = if covariance < -bound { -bound } else { covariance };
    let brightness = (2.0 * a.0 * b.0 + LITTLE) / (a.0 * a.0 + b.0 * b.0 + LITTLE);
    let structure = (2.0 * covariance + LITTLE) / (a.1 + b.1 + LITTLE);
    brightness * structure
}
