//! The tone curve of the camera: from stored values to light.
//!
//! The mean light over whole grid steps does not change with blur, whatever the shape of the blur, but the stored
//! values are a curve of the light. The curve is modelled by one number `t`:
//!
//! `light_t(v) = (1 - t) v + t srgb(v)`, with `v` the stored value, 0 to 1, and `srgb` the decoding of IEC 61966-2-1.
//!
//! `t = 0` is a linear camera, `t = 1` sRGB, more than 1 a curve with more contrast. The family is linear in `t`, so
//! the mean light for any `t` follows from two measured means.

use crate::calibration::dot_photometry::{DotBrightness, to_light};

/// The values of `t` that are compared.
pub(super) const TONES: usize = 31;

/// Value number `k` of `t`: -0.25 to 1.625 in steps of 1/16.
pub(super) fn tone(k: usize) -> f64 {
    k as f64 / 16.0 - 0.25
}

/// The most likely `t` without other knowledge, and its standard deviation.
const PRIOR: (f64, f64) = (1.0, 0.6);

/// Twice the negative logarithm of the prior probability of `t`, up to a constant.
pub(super) fn prior_cost(t: f64) -> f64 {
    ((t - PRIOR.0) / PRIOR.1).powi(2)
}

/// Mean light at a dot for the curve `t`, on the scale 0..255; `None` where it was not measured.
pub(super) fn mean_light(light: &DotBrightness, t: f64) -> Option<f64> {
    Some((1.0 - t) * light.mean + t * 255.0 * light.linear_mean?)
}

/// Light, 0..1, of the stored value `v`, 0..1.
fn light(v: f64, t: f64) -> f64 {
    (1.0 - t) * v + t * to_light(255.0 * v)
}

/// `ln` of the factor on stored values, at the bright level `level` (0..255), that makes up for `ln_light`, the `ln` of
/// the factor on light. `None` where the curve is not defined at that level.
pub(super) fn value_gain(ln_light: f64, level: f64, t: f64) -> Option<f64> {
    let base = level / 255.0;
    let wanted = light(base, t) * (-ln_light).exp();
    if !(wanted > 0.0 && wanted.is_finite() && base > 0.0) {
        return None;
    }
    // light_t is negative or rising, so it meets a positive value once
    let (mut low, mut high) = (0.0, 4.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if light(middle, t) < wanted { low = middle } else { high = middle }
    }
    Some((base / high).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_curve_keeps_the_factor_and_srgb_shrinks_it() {
        for ln_light in [-0.7, -0.1, 0.0, 0.3] {
            let linear = value_gain(ln_light, 200.0, 0.0).expect("a level");
            assert!((linear - ln_light).abs() < 1e-9, "{linear} for {ln_light}");
        }
        let level = 200.0;
        let darker = 150.0;
        let ratio: f64 = to_light(level) / to_light(darker);
        let srgb = value_gain(ratio.ln(), level, 1.0).expect("a level");
        assert!((srgb - (level / darker).ln()).abs() < 1e-9, "{srgb}");
        assert_eq!(value_gain(0.1, 2.0, 1.5), None, "the curve is negative there");
    }
}
