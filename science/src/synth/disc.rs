//! Blur by a disc whose radius may change from pixel to pixel.
//!
//! Independent of `imaging/filter/disc.rs` on purpose: the rendered truth must not share code with the method that it
//! evaluates.

/// Radii are rounded to this fraction of a pixel, so that discs can be tabulated.
const STEPS_PER_PX: f64 = 16.0;

/// One disc, row by row: half of the chord in each row of pixels, averaged over the height of the row.
#[derive(Debug)]
struct Disc {
    half_chords: Vec<f32>,
    inverse_area: f32,
}

impl Disc {
    fn new(radius: f64) -> Self {
        if radius <= 0.5 {
            return Self { half_chords: vec![0.5], inverse_area: 1.0 };
        }
        let reach = (radius - 0.5).ceil() as i64;
        // area under the circle's upper arc from 0 to y
        let primitive = |y: f64| {
            let y = y.clamp(-radius, radius);
            0.5 * (y * (radius * radius - y * y).max(0.0).sqrt() + radius * radius * (y / radius).asin())
        };
        let half_chords: Vec<f32> =
            (-reach..=reach).map(|row| (primitive(row as f64 + 0.5) - primitive(row as f64 - 0.5)) as f32).collect();
        let inverse_area = 1.0 / (2.0 * half_chords.iter().sum::<f32>());
        Self { half_chords, inverse_area }
    }
}

/// All discs up to a radius.
#[derive(Debug)]
pub(super) struct Discs(Vec<Disc>);

impl Discs {
    /// Discs for blur radii of 0 to `largest` px.
    pub(super) fn up_to(largest: f64) -> Self {
        let count = (largest.max(0.0) * STEPS_PER_PX).ceil() as usize + 2;
        Self((0..count).map(|step| Disc::new(radius_without_pixel_spread(step as f64 / STEPS_PER_PX))).collect())
    }

    fn of(&self, radius: f32) -> &Disc {
        let step = (radius * STEPS_PER_PX as f32).round() as usize;
        &self.0[step.min(self.0.len() - 1)]
    }
}

/// Summing whole pixels widens a disc by the second moment of a pixel: 1/12 per axis; that of a disc is r^2 / 4. The
/// radius is reduced accordingly, so that the blur has the requested width.
fn radius_without_pixel_spread(radius: f64) -> f64 {
    (radius * radius - 1.0 / 3.0).max(0.0).sqrt()
}

/// A patch of `C`-channel samples with prefix sums along its rows, from which means over discs are computed.
#[derive(Debug)]
pub(super) struct Patch<const C: usize> {
    width: usize,
    height: usize,
    sums: Vec<[f32; C]>,
}

impl<const C: usize> Patch<C> {
    /// `samples`: `width * height`, row-major.
    pub(super) fn new(width: usize, height: usize, samples: &[[f32; C]]) -> Self {
        let mut sums = Vec::with_capacity((width + 1) * height);
        for row in samples.chunks_exact(width) {
            let mut sum = [0.0_f32; C];
            sums.push(sum);
            for sample in row {
                for channel in 0..C {
                    sum[channel] += sample[channel];
                }
                sums.push(sum);
            }
        }
        Self { width, height, sums }
    }

    /// The mean over the disc of `radius` px around the centre of pixel (x, y). Samples outside the patch count as
    /// zero.
    pub(super) fn mean(&self, discs: &Discs, x: usize, y: usize, radius: f32) -> [f32; C] {
        let disc = discs.of(radius);
        let reach = disc.half_chords.len() / 2;
        let mut total = [0.0_f32; C];
        for (row, &half) in disc.half_chords.iter().enumerate() {
            let Some(source) = (y + row).checked_sub(reach).filter(|&source| source < self.height) else {
                continue;
            };
            let sums = &self.sums[source * (self.width + 1)..(source + 1) * (self.width + 1)];
            let centre = x as f32 + 0.5;
            let (right, left) = (self.up_to(sums, centre + half), self.up_to(sums, centre - half));
            for channel in 0..C {
                total[channel] += right[channel] - left[channel];
            }
        }
        total.map(|value| value * disc.inverse_area)
    }

    /// The sum of a row from its left end to `position`, each sample one unit wide.
    #[inline]
    fn up_to(&self, sums: &[[f32; C]], position: f32) -> [f32; C] {
        let position = position.clamp(0.0, self.width as f32);
        let cell = (position as usize).min(self.width - 1);
        let share = position - cell as f32;
        let (from, to) = (&sums[cell], &sums[cell + 1]);
        std::array::from_fn(|channel| from[channel] + share * (to[channel] - from[channel]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point_spread(radius: f32) -> Vec<[f32; 1]> {
        let mut samples = vec![[0.0]; 31 * 31];
        samples[15 * 31 + 15] = [1.0];
        let patch = Patch::new(31, 31, &samples);
        let discs = Discs::up_to(12.0);
        (0..31 * 31).map(|at| patch.mean(&discs, at % 31, at / 31, radius)).collect()
    }

    #[test]
    fn a_point_becomes_a_disc_of_the_same_light_and_the_right_width() {
        for radius in [0.0_f32, 0.4, 1.0, 2.5, 6.0, 11.0] {
            let spread = point_spread(radius);
            let light: f32 = spread.iter().map(|v| v[0]).sum();
            assert!((light - 1.0).abs() < 1e-4, "radius {radius}: {light}");
            let moment: f32 = spread.iter().enumerate().map(|(at, v)| v[0] * (at as f32 % 31.0 - 15.0).powi(2)).sum();
            let expected = radius * radius / 4.0;
            assert!((moment - expected).abs() < 0.06 + 0.03 * expected, "radius {radius}: {moment} for {expected}");
        }
    }

    #[test]
    fn no_blur_changes_nothing() {
        let samples: Vec<[f32; 1]> = (0..64).map(|at| [at as f32]).collect();
        let patch = Patch::new(8, 8, &samples);
        let discs = Discs::up_to(3.0);
        for at in 0..64 {
            assert!((patch.mean(&discs, at % 8, at / 8, 0.0)[0] - at as f32).abs() < 1e-4);
        }
    }
}
