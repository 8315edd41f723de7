//! What is noted about each warped slice while it is in memory.

mod brightness;

use super::{
    sampling::Sampling,
    tile::{same_shape, sobel, whole_neighbourhoods},
};
use crate::imaging::Plane;

pub(super) use brightness::Blocks;

/// Luma from which a pixel is at full scale, and under which it is at zero (0..255).
const FULL: f32 = 254.0;
const ZERO: f32 = 0.5;

/// Looks at the warped slices of one stack, one at a time, in any order, from any thread.
#[derive(Debug, Clone)]
pub struct Observer<'a> {
    width: usize,
    height: usize,
    reference: usize,
    object: Option<&'a Plane<u8>>,
}

/// What was noted about one slice.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    pub(super) index: usize,
    pub(super) reference: usize,
    /// Mean squared Sobel gradient.
    pub(super) tenengrad: Option<f64>,
    /// Share of the covered pixels at full scale or at zero.
    pub(super) clipped: Option<f64>,
    /// Share of the canvas that is covered.
    pub(super) covered: Option<f64>,
    pub(super) blocks: Blocks,
    pub(super) sampling: Sampling,
    /// Saliency at the positions of the sampling; NaN where the slice does not cover.
    pub(super) saliency: Vec<f32>,
}

impl<'a> Observer<'a> {
    /// An observer of `slices` warped slices on a canvas of `width` x `height` px; `reference` is the slice
    /// that exposures are compared with (a number that is too large means the last one).
    pub fn new(width: usize, height: usize, slices: usize, reference: usize) -> Self {
        Self { width, height, reference: reference.min(slices.saturating_sub(1)), object: None }
    }

    /// Restricts sharpness and clipping to the object (255; elsewhere 0), when it is known by then.
    #[must_use]
    pub fn within(mut self, object: Option<&'a Plane<u8>>) -> Self {
        self.object = object.filter(|object| object.width == self.width && object.height == self.height);
        self
    }

    /// Notes what matters of warped slice `index`: `luma` 0..255 with the gain applied, `valid` 255 where
    /// the slice covers the canvas, `saliency` as fusion uses it, `gain` as applied. Planes that are not of
    /// the canvas's size count as covering nothing.
    pub fn slice(&self, index: usize, luma: &Plane<f32>, valid: &Plane<u8>, saliency: &Plane<f32>, gain: f64) -> Seen {
        let sampling = Sampling::new(self.width, self.height);
        let fits = luma.width == self.width && luma.height == self.height;
        let mut seen = Seen {
            index,
            reference: self.reference,
            tenengrad: None,
            clipped: None,
            covered: None,
            blocks: Blocks::default(),
            sampling,
            saliency: vec![f32::NAN; sampling.positions().count()],
        };
        if !fits || !same_shape(luma, valid) || !same_shape(luma, saliency) {
            return seen;
        }
        // a gain that is no gain would make every brightness senseless
        let gain = if gain.is_finite() && gain > 0.0 { gain as f32 } else { 1.0 };
        seen.covered = ratio(valid.data.iter().filter(|&&v| v != 0).count(), valid.data.len());
        seen.clipped = self.clipped(luma, valid, gain);
        seen.tenengrad = self.tenengrad(luma, valid);
        seen.blocks = Blocks::of(luma, valid, gain);
        for (kept, (x, y)) in seen.saliency.iter_mut().zip(sampling.positions()) {
            let value = saliency.at(x, y);
            if valid.at(x, y) != 0 && value.is_finite() {
                *kept = value;
            }
        }
        seen
    }

    fn clipped(&self, luma: &Plane<f32>, valid: &Plane<u8>, gain: f32) -> Option<f64> {
        let (mut clipped, mut count) = (0, 0);
        for y in 0..luma.height {
            let (values, covered) = (luma.row(y), valid.row(y));
            let object = self.object.map(|object| object.row(y));
            for x in 0..luma.width {
                let counts = covered[x] != 0 && object.is_none_or(|object| object[x] != 0);
                count += usize::from(counts);
                clipped += usize::from(counts && is_clipped(values[x], gain));
            }
        }
        ratio(clipped, count)
    }

    fn tenengrad(&self, luma: &Plane<f32>, valid: &Plane<u8>) -> Option<f64> {
        let inner = luma.width.checked_sub(2)?;
        let neighbours = match valid.data.iter().all(|&v| v != 0) {
            true => None,
            false => Some(whole_neighbourhoods(valid, 3)),
        };
        let (mut sum, mut count) = (0.0f64, 0);
        let mut energies = vec![0.0f32; inner];
        for y in 0..luma.height.saturating_sub(2) {
            let [upper, middle, lower] = [luma.row(y), luma.row(y + 1), luma.row(y + 2)];
            for (x, energy) in energies.iter_mut().enumerate() {
                let (gx, gy) = sobel(upper, middle, lower, x);
                *energy = gx * gx + gy * gy;
            }
            let object = self.object.map(|object| &object.row(y + 1)[1..]);
            let neighbours = neighbours.as_ref().map(|valid| valid.row(y));
            if object.is_none() && neighbours.is_none() {
                sum += sum_of(&energies);
                count += inner;
                continue;
            }
            for x in 0..inner {
                if object.is_none_or(|object| object[x] != 0) && neighbours.is_none_or(|valid| valid[x] != 0) {
                    sum += f64::from(energies[x]);
                    count += 1;
                }
            }
        }
        (count > 0).then(|| sum / count as f64).filter(|mean| mean.is_finite())
    }
}

/// Whether a pixel was clipped in the file (before the gain) or is clipped by the gain.
#[inline]
fn is_clipped(luma: f32, gain: f32) -> bool {
    luma >= FULL || luma >= FULL * gain || luma < ZERO
}

fn ratio(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// The sum in eight lanes, which the compiler turns into vector additions.
fn sum_of(values: &[f32]) -> f64 {
    let mut lanes = [0.0f32; 8];
    let chunks = values.chunks_exact(8);
    let rest: f32 = chunks.remainder().iter().sum();
    for chunk in chunks {
        lanes.iter_mut().zip(chunk).for_each(|(lane, value)| *lane += value);
    }
    lanes.iter().map(|&lane| f64::from(lane)).sum::<f64>() + f64::from(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    fn scene() -> Plane<f32> {
        Plane::from_fn(WIDTH, HEIGHT, |x, y| 60.0 + ((x * 31 + y * 17) % 97) as f32)
    }

    fn covered() -> Plane<u8> {
        Plane::filled(WIDTH, HEIGHT, 255)
    }

    fn observe(index: usize, luma: &Plane<f32>, valid: &Plane<u8>, gain: f64) -> Seen {
        Observer::new(WIDTH, HEIGHT, 2, 0).slice(index, luma, valid, luma, gain)
    }

    #[test]
    fn exposure_is_that_before_the_gain() {
        let reference = observe(0, &scene(), &covered(), 1.0);
        let darker = observe(1, &scene(), &covered(), 1.25);
        let ratio = darker.blocks.exposure_ratio(&reference.blocks).unwrap();
        assert!((ratio - 0.8).abs() < 1e-6, "{ratio}");
    }

    #[test]
    fn clipped_blocks_do_not_bend_the_exposure() {
        let bright = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 32 { scene().at(x, y) / 2.0 } else { 200.0 });
        let doubled = bright.map(|v| (2.0 * v).min(255.0));
        let (one, two) = (observe(0, &bright, &covered(), 1.0), observe(1, &doubled, &covered(), 1.0));
        let ratio = two.blocks.exposure_ratio(&one.blocks).unwrap();
        assert!((ratio - 2.0).abs() < 1e-3, "{ratio}");
        let share = two.clipped.unwrap();
        assert!((0.5..0.8).contains(&share), "{share}");
        assert_eq!(one.clipped, Some(0.0));
    }

    #[test]
    fn what_a_slice_does_not_cover_enters_no_number() {
        let valid = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x < 32 { 255u8 } else { 0 });
        let torn = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 32 { scene().at(x, y) } else { f32::NAN });
        let seen = observe(1, &torn, &valid, 1.0);
        assert_eq!(seen.covered, Some(0.5));
        assert_eq!(seen.clipped, Some(0.0));
        assert!(seen.tenengrad.unwrap() > 0.0);
        assert_eq!(seen.saliency.iter().filter(|s| s.is_nan()).count(), WIDTH * HEIGHT / 2);
        let whole = observe(0, &scene(), &covered(), 1.0);
        assert!((seen.blocks.exposure_ratio(&whole.blocks).unwrap() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_slice_that_covers_nothing_has_no_sharpness_and_no_exposure() {
        let seen = observe(1, &scene(), &covered().map(|_| 0), 1.0);
        assert_eq!((seen.tenengrad, seen.clipped, seen.covered), (None, None, Some(0.0)));
        assert_eq!(seen.blocks.exposure_ratio(&observe(0, &scene(), &covered(), 1.0).blocks), None);
    }

    #[test]
    fn only_the_object_counts_for_clipping_and_sharpness() {
        let object = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x < 20 { 255u8 } else { 0 });
        let black = Plane::from_fn(WIDTH, HEIGHT, |x, y| if x < 20 { scene().at(x, y) } else { 0.0 });
        let observer = Observer::new(WIDTH, HEIGHT, 2, 0);
        let alone = observer.clone().within(Some(&object)).slice(0, &black, &covered(), &black, 1.0);
        let all = observer.slice(0, &black, &covered(), &black, 1.0);
        assert_eq!(alone.clipped, Some(0.0));
        assert!(all.clipped.unwrap() > 0.6);
        assert!(alone.tenengrad.unwrap() > 2.0 * all.tenengrad.unwrap());
    }

    #[test]
    fn tenengrad_of_a_ramp_is_its_slope_seen_by_sobel() {
        let ramp = Plane::from_fn(WIDTH, HEIGHT, |x, _| 2.0 * x as f32);
        assert_eq!(observe(0, &ramp, &covered(), 1.0).tenengrad, Some(256.0));
    }

    #[test]
    fn planes_of_another_size_cover_nothing() {
        let small = Plane::filled(8, 8, 1.0f32);
        let seen = observe(0, &small, &Plane::filled(8, 8, 255), 1.0);
        assert_eq!((seen.covered, seen.tenengrad), (None, None));
    }
}
