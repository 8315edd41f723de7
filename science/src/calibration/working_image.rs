//! The working image: grey, at a resolution that suits the dot pitch. Dots are measured in it.

use std::ops::Range;

use rayon::prelude::*;

use crate::imaging::{LUMA, Plane, Raster, Samples};

/// A grey image, 0..255, averaged over `bin` x `bin` pixels of the slice. Averaging does not move the centres of dots;
/// it reduces noise and time.
#[derive(Debug, Clone)]
pub(super) struct WorkingImage {
    /// The samples.
    pub plane: Plane<f32>,
    /// Pixels of the slice per sample, along each axis.
    pub bin: usize,
    /// Share of the slice's pixels at full scale.
    pub clipped: f64,
    /// The same per sample; `None` when at most one pixel in ten thousand is at full scale.
    pub full: Option<Plane<f32>>,
}

/// Grey level from which a pixel counts as clipped, of 255.
const FULL: f32 = 254.5;

impl WorkingImage {
    /// The green channel of `slice`, or its Rec. 601 luma where green shows too little, averaged over cells of `bin`
    /// pixels. Incomplete cells at the right and bottom are dropped. One pass over the slice.
    ///
    /// A lens with lateral colour images red and blue at other scales than green, and luma would mix their positions.
    pub(super) fn of(slice: &Raster, bin: usize) -> Self {
        match &slice.samples {
            Samples::Eight(s) => Self::of_samples(slice, s, bin, f32::from),
            Samples::Sixteen(s) => {
                let scale = 255.0 / 65_535.0;
                Self::of_samples(slice, s, bin, move |v| f32::from(v) * scale)
            }
        }
    }

    fn of_samples<T: Copy + Sync>(slice: &Raster, s: &[T], bin: usize, value: impl Fn(T) -> f32 + Sync) -> Self {
        let bin = bin.clamp(1, slice.width.min(slice.height).max(1));
        let step = slice.channels;
        if step >= 3 && green_is_clear(s, step, &value) {
            Self::averaged(slice, bin, |k| value(s[k * step + 1]))
        } else {
            Self::averaged(slice, bin, |k| luma(&s[k * step..(k + 1) * step], &value))
        }
    }

    fn averaged(slice: &Raster, bin: usize, grey: impl Fn(usize) -> f32 + Sync) -> Self {
        let (width, height) = (slice.width / bin, slice.height / bin);
        let scale = 1.0 / (bin * bin) as f32;
        let mut data = vec![0.0_f32; width * height];
        let mut full = vec![0.0_f32; width * height];
        data.par_chunks_exact_mut(width).zip(full.par_chunks_exact_mut(width)).enumerate().for_each(
            |(y, (out, full))| {
                for row in y * bin..(y + 1) * bin {
                    let first = row * slice.width;
                    for (x, (sum, full)) in out.iter_mut().zip(full.iter_mut()).enumerate() {
                        let mut over = 0_u32;
                        for k in first + x * bin..first + (x + 1) * bin {
                            let value = grey(k);
                            *sum += value;
                            over += u32::from(value >= FULL);
                        }
                        *full += scale * over as f32;
                    }
                }
                out.iter_mut().for_each(|v| *v *= scale);
            },
        );
        let clipped = full.iter().map(|v| f64::from(*v)).sum::<f64>() / full.len().max(1) as f64;
        let full = (clipped > 1e-4).then_some(Plane { width, height, data: full });
        Self { plane: Plane { width, height, data }, bin, clipped, full }
    }

    /// Coordinates in this image to pixels of the slice.
    pub(super) fn to_slice(&self, p: [f64; 2]) -> [f64; 2] {
        let k = self.bin as f64;
        p.map(|v| v * k + (k - 1.0) / 2.0)
    }

    /// Pixels of the slice to coordinates in this image.
    pub(super) fn to_plane(&self, p: [f64; 2]) -> [f64; 2] {
        let k = self.bin as f64;
        p.map(|v| (v - (k - 1.0) / 2.0) / k)
    }
}

/// Pixels by which the channels are compared.
const COMPARED: usize = 20_000;
/// Least contrast of green, relative to the strongest channel.
const CLEAR: f64 = 0.5;

/// True when green has at least half of the contrast of the strongest channel.
fn green_is_clear<T: Copy>(samples: &[T], channels: usize, value: impl Fn(T) -> f32) -> bool {
    let every = (samples.len() / channels).div_ceil(COMPARED).max(1);
    let mut sums = [[0.0_f64; 3]; 3];
    for pixel in samples.chunks_exact(channels).step_by(every) {
        for (sum, v) in sums.iter_mut().zip(pixel) {
            let v = f64::from(value(*v));
            *sum = [sum[0] + 1.0, sum[1] + v, sum[2] + v * v];
        }
    }
    let variance = sums.map(|[n, sum, squares]| (squares / n.max(1.0) - (sum / n.max(1.0)).powi(2)).max(0.0));
    variance[1].sqrt() >= CLEAR * variance.iter().fold(0.0_f64, |most, v| most.max(*v)).sqrt()
}

#[inline]
fn luma<T: Copy>(pixel: &[T], value: impl Fn(T) -> f32) -> f32 {
    match pixel {
        [r, g, b, ..] => LUMA[0] * value(*r) + LUMA[1] * value(*g) + LUMA[2] * value(*b),
        [grey, ..] => value(*grey),
        [] => 0.0,
    }
}

/// The pixels of `range` within `reach` of `v`, along one axis.
#[inline]
pub(super) fn pixels_within(v: f64, reach: f64, range: Range<usize>) -> Range<usize> {
    let low = (v - reach).ceil().clamp(range.start as f64, range.end as f64) as usize;
    low..((v + reach).floor() + 1.0).clamp(low as f64, range.end as f64) as usize
}

/// Bilinear sample; `None` outside.
pub(super) fn sample(plane: &Plane<f32>, p: [f64; 2]) -> Option<f32> {
    let inside = p[0] >= 0.0 && p[1] >= 0.0 && p[0] <= plane.width as f64 - 1.0 && p[1] <= plane.height as f64 - 1.0;
    if !inside || plane.width < 2 || plane.height < 2 {
        return None;
    }
    let x = (p[0] as usize).min(plane.width - 2);
    let y = (p[1] as usize).min(plane.height - 2);
    let (fx, fy) = ((p[0] - x as f64) as f32, (p[1] - y as f64) as f32);
    let top = plane.at(x, y) * (1.0 - fx) + plane.at(x + 1, y) * fx;
    let bottom = plane.at(x, y + 1) * (1.0 - fx) + plane.at(x + 1, y + 1) * fx;
    Some(top * (1.0 - fy) + bottom * fy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binning_keeps_the_centre_of_a_dot() {
        let samples = (0..3600).map(|k| {
            let (dx, dy) = ((k % 60) as f64 - 31.3, (k / 60) as f64 - 27.8);
            (60_000.0 * (-(dx * dx + dy * dy) / 60.0).exp()).round() as u16
        });
        let working = WorkingImage::of(&Raster::sixteen(60, 60, 1, samples.collect()), 3);
        let (mut sum, mut at) = (0.0, [0.0, 0.0]);
        for y in 0..working.plane.height {
            for x in 0..working.plane.width {
                let v = f64::from(working.plane.at(x, y));
                sum += v;
                at = [at[0] + v * x as f64, at[1] + v * y as f64];
            }
        }
        let back = working.to_slice([at[0] / sum, at[1] / sum]);
        assert!((back[0] - 31.3).abs() < 0.02 && (back[1] - 27.8).abs() < 0.02, "{back:?}");
        let there = working.to_plane(back);
        assert!((there[0] - at[0] / sum).abs() < 1e-12);
    }

    #[test]
    fn a_sample_outside_is_none_and_one_between_pixels_is_their_mean() {
        let plane = Plane::from_fn(4, 4, |x, y| (x + 10 * y) as f32);
        assert_eq!(sample(&plane, [0.5, 0.5]), Some(5.5));
        assert_eq!(sample(&plane, [3.0, 3.0]), Some(33.0));
        assert_eq!(sample(&plane, [3.1, 0.0]), None);
        assert_eq!(sample(&plane, [-0.1, 0.0]), None);
        assert_eq!(sample(&plane, [f64::NAN, 0.0]), None);
    }
}
