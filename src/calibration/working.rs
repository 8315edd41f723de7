//! The grey plane that dots are measured in: the slice at a resolution that suits the size of its dots.

use crate::imaging::Plane;

/// A grey picture, 0..255, averaged over `bin` x `bin` pixels of the slice. Averaging keeps the centres of
/// dots where they are and takes noise and time away.
#[derive(Debug, Clone)]
pub struct Working {
    /// The samples.
    pub plane: Plane<f32>,
    /// Pixels of the slice per sample, along each axis.
    pub bin: usize,
}

impl Working {
    /// Averages `luma` over cells of `bin` pixels; what is left over at the right and bottom is cut off.
    pub fn new(luma: &Plane<f32>, bin: usize) -> Self {
        let bin = bin.clamp(1, luma.width.min(luma.height).max(1));
        if bin == 1 {
            return Self { plane: luma.clone(), bin };
        }
        let (width, height) = (luma.width / bin, luma.height / bin);
        let scale = 1.0 / (bin * bin) as f32;
        let mut data = vec![0.0_f32; width * height];
        for (y, out) in data.chunks_exact_mut(width).enumerate() {
            for row in y * bin..(y + 1) * bin {
                for (sum, cell) in out.iter_mut().zip(luma.row(row).chunks_exact(bin)) {
                    *sum += cell.iter().sum::<f32>();
                }
            }
            out.iter_mut().for_each(|v| *v *= scale);
        }
        Self { plane: softened(&Plane { width, height, data }), bin }
    }

    /// A place of this plane in pixels of the slice.
    pub fn to_slice(&self, p: [f64; 2]) -> [f64; 2] {
        let k = self.bin as f64;
        p.map(|v| v * k + (k - 1.0) / 2.0)
    }

    /// A pixel of the slice as a place of this plane.
    pub fn place_of(&self, p: [f64; 2]) -> [f64; 2] {
        let k = self.bin as f64;
        p.map(|v| (v - (k - 1.0) / 2.0) / k)
    }
}

/// Smoothed by 1 2 1 along each axis: averaging leaves edges sharper than the samples can carry.
fn softened(plane: &Plane<f32>) -> Plane<f32> {
    let (right, bottom) = (plane.width - 1, plane.height - 1);
    let across = Plane::from_fn(plane.width, plane.height, |x, y| {
        let row = plane.row(y);
        0.25 * (row[x.saturating_sub(1)] + 2.0 * row[x] + row[(x + 1).min(right)])
    });
    Plane::from_fn(plane.width, plane.height, |x, y| {
        0.25 * (across.at(x, y.saturating_sub(1)) + 2.0 * across.at(x, y) + across.at(x, (y + 1).min(bottom)))
    })
}

/// Bilinear sample; `None` outside.
pub fn sample(plane: &Plane<f32>, p: [f64; 2]) -> Option<f32> {
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

/// The value below which `share` (0..1) of the numbers lie. 0 when there are none. Reorders `values`.
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// The middle value. 0 when there are none. Reorders `values`.
pub fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binning_keeps_the_centre_of_a_dot() {
        let luma = Plane::from_fn(60, 60, |x, y| {
            let (dx, dy) = (x as f32 - 31.3, y as f32 - 27.8);
            (-(dx * dx + dy * dy) / 60.0).exp()
        });
        let working = Working::new(&luma, 3);
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
        let there = working.place_of(back);
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
