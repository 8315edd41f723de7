//! From light to stored samples: exposure, vignetting, noise, quantisation.

use rayon::prelude::*;

use super::Rig;
use super::noise::{key, normal};
use crate::imaging::{LUMA, Raster, Samples};

/// How the object is lit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Light {
    /// From the front: the colours of the object.
    Front,
    /// From behind: a bright field with the object as a dark silhouette.
    Back,
}

/// The raster that the sensor of slice `i` stores. `radiance(y, row)` fills row `y` with RGB light, 0..1 of full scale
/// at the reference exposure. `salt` makes the noise of different images independent.
pub(super) fn expose(rig: &Rig, i: usize, salt: u64, radiance: impl Fn(usize, &mut [[f32; 3]]) + Sync) -> Raster {
    expose_as(rig, i, salt, |light| light, radiance)
}

/// The same for a sensor that stores `response(light)` plus noise.
pub(super) fn expose_as(
    rig: &Rig,
    i: usize,
    salt: u64,
    response: impl Fn(f32) -> f32 + Sync,
    radiance: impl Fn(usize, &mut [[f32; 3]]) + Sync,
) -> Raster {
    let samples = expose_clean(rig, rig.exposure(i), radiance);
    let noise_key = key(&[rig.seed, salt, i as u64]);
    let sigma = (rig.noise / 255.0) as f32;
    let with_noise = |at: usize, light: f32| {
        let light = response(light);
        if sigma > 0.0 {
            light + sigma * normal(noise_key ^ (at as u64).wrapping_mul(0x2545_f491_4f6c_dd1d))
        } else {
            light
        }
    };
    quantise(rig, &samples, with_noise)
}

/// Relative light at `px` after vignetting, 1 at the centre.
pub(super) fn transmission(rig: &Rig, px: [f64; 2]) -> f64 {
    let [cx, cy] = rig.centre();
    let corner = (cx * cx + cy * cy).max(1.0);
    let squared = (px[0] - cx).powi(2) + (px[1] - cy).powi(2);
    1.0 - rig.vignetting * squared / corner
}

/// Light with exposure and vignetting, in the channels of the rig, before noise and quantisation.
pub(super) fn expose_clean(rig: &Rig, exposure: f64, radiance: impl Fn(usize, &mut [[f32; 3]]) + Sync) -> Vec<f32> {
    let mut samples = vec![0.0_f32; rig.width * rig.height * rig.channels];
    samples.par_chunks_mut(rig.width * rig.channels).enumerate().for_each(|(y, row)| {
        let mut light = vec![[0.0_f32; 3]; rig.width];
        radiance(y, &mut light);
        for (x, (rgb, out)) in light.iter().zip(row.chunks_exact_mut(rig.channels)).enumerate() {
            let factor = (exposure * transmission(rig, [x as f64, y as f64])) as f32;
            match out {
                [grey] => *grey = factor * (LUMA[0] * rgb[0] + LUMA[1] * rgb[1] + LUMA[2] * rgb[2]),
                _ => out.iter_mut().zip(rgb).for_each(|(sample, value)| *sample = factor * value),
            }
        }
    });
    soften(&mut samples, rig);
    samples
}

/// Blurs the light by the Gaussian of the rig, with repeated borders.
fn soften(samples: &mut [f32], rig: &Rig) {
    let (sigma, channels, stride) = (rig.softness_px as f32, rig.channels, rig.width * rig.channels);
    if sigma.is_nan() || sigma <= 0.0 || samples.is_empty() {
        return;
    }
    let reach = (4.0 * sigma).ceil() as usize;
    let half: Vec<f32> = (0..=reach).map(|d| (-((d * d) as f32) / (2.0 * sigma * sigma)).exp()).collect();
    let sum = half[0] + 2.0 * half[1..].iter().sum::<f32>();
    let both = |at: &dyn Fn(isize) -> f32| {
        let pairs = half.iter().enumerate().skip(1).map(|(d, weight)| weight * (at(-(d as isize)) + at(d as isize)));
        (half[0] * at(0) + pairs.sum::<f32>()) / sum
    };
    let mut across = vec![0.0f32; samples.len()];
    across.par_chunks_mut(stride).zip(samples.par_chunks(stride)).for_each(|(out, row)| {
        for (at, out) in out.iter_mut().enumerate() {
            let (x, channel) = (at / channels, at % channels);
            *out = both(&|by| row[x.saturating_add_signed(by).min(rig.width - 1) * channels + channel]);
        }
    });
    samples.par_chunks_mut(stride).enumerate().for_each(|(y, out)| {
        for (at, out) in out.iter_mut().enumerate() {
            *out = both(&|by| across[y.saturating_add_signed(by).min(rig.height - 1) * stride + at]);
        }
    });
}

/// The stored samples. `disturb(index, light)` may change each before it is rounded.
pub(super) fn quantise(rig: &Rig, light: &[f32], disturb: impl Fn(usize, f32) -> f32 + Sync) -> Raster {
    let full = rig.depth.max();
    let level = |(at, &value): (usize, &f32)| (disturb(at, value) * full).round().clamp(0.0, full);
    let samples = match rig.depth {
        crate::imaging::Depth::Eight => {
            Samples::Eight(light.par_iter().enumerate().map(|sample| level(sample) as u8).collect())
        }
        crate::imaging::Depth::Sixteen => {
            Samples::Sixteen(light.par_iter().enumerate().map(|sample| level(sample) as u16).collect())
        }
    };
    Raster { width: rig.width, height: rig.height, channels: rig.channels, samples }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_soft_rig_spreads_a_point_as_wide_as_told_and_loses_no_light() {
        for softness_px in [0.7, 1.0, 1.5] {
            let rig = Rig { softness_px, channels: 1, ..Rig::sized(41, 31, 1).ideal() };
            let point = |y: usize, row: &mut [[f32; 3]]| {
                row.iter_mut().enumerate().for_each(|(x, rgb)| *rgb = [if (x, y) == (20, 15) { 1.0 } else { 0.0 }; 3]);
            };
            let light = expose_clean(&rig, 1.0, point);
            let (mut sum, mut spread) = (0.0f64, 0.0f64);
            for (at, &value) in light.iter().enumerate() {
                sum += f64::from(value);
                spread += f64::from(value) * (at as f64 % 41.0 - 20.0).powi(2);
            }
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
            assert!(((spread / sum).sqrt() - softness_px).abs() < 0.02, "{spread} for {softness_px}");
        }
    }

    #[test]
    fn a_rig_without_softness_changes_nothing() {
        let rig = Rig { channels: 1, ..Rig::sized(24, 16, 1).ideal() };
        let checks = |y: usize, row: &mut [[f32; 3]]| {
            row.iter_mut().enumerate().for_each(|(x, rgb)| *rgb = [((x + y) % 2) as f32; 3]);
        };
        let light = expose_clean(&rig, 1.0, checks);
        assert!(light.iter().enumerate().all(|(at, &value)| value == ((at % 24 + at / 24) % 2) as f32));
    }
}
