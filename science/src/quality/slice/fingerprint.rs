//! Fingerprint of an image: reveals whether two files hold the same image, possibly encoded twice.
//!
//! It samples second differences at a grid of points. These contain the sensor noise, which differs between two
//! exposures of one scene, so only copies of one exposure correlate almost fully.

use crate::imaging::Sample;

/// Sample points in each direction.
const GRID: usize = 96;
/// Two fingerprints that correlate more than this are of the same image. Two exposures of one scene differ in noise,
/// which is as strong as fine texture, and correlate clearly less.
const SAME: f64 = 0.9999;
/// Mean squared difference below which there is too little texture to compare: of 8 bits in squared grey levels, of 16
/// bits in squared units of two sample values. Almost no picture of 16 bits is below it.
const LEAST_ENERGY: f64 = 0.25;

/// Second differences at a grid of points over the slice as it is in the file, before warping.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fingerprint {
    differences: Vec<i16>,
}

impl Fingerprint {
    /// The fingerprint of a `width` x `height` image of interleaved samples with 1 or 3 `channels`; empty if the image
    /// is smaller than 4 x 4 px.
    pub fn of<S: Sample>(samples: &[S], channels: usize, width: usize, height: usize) -> Self {
        if width < 4 || height < 4 || samples.len() != width * height * channels {
            return Self::default();
        }
        let green = channels / 2;
        let shift = if S::BYTES == 2 { 1 } else { 0 };
        let at = |x: usize, y: usize| (samples[(y * width + x) * channels + green].integer() >> shift) as i32;
        let (across, down) = (GRID.min(width - 2), GRID.min(height - 2));
        let mut differences = Vec::with_capacity(across * down);
        for j in 0..down {
            let y = j * (height - 2) / down;
            for i in 0..across {
                let x = i * (width - 2) / across;
                let difference = at(x, y) - at(x + 1, y) - at(x, y + 1) + at(x + 1, y + 1);
                differences.push(difference.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16);
            }
        }
        Self { differences }
    }

    /// Whether both are of the same image, possibly encoded twice. False when there is too little texture to compare.
    pub(crate) fn is_same_image(&self, other: &Self) -> bool {
        if self.differences.len() != other.differences.len() {
            return false;
        }
        let (mut aa, mut bb, mut ab) = (0.0f64, 0.0f64, 0.0f64);
        // most pairs differ clearly within their first rows
        let chunks = self.differences.chunks(8 * GRID).zip(other.differences.chunks(8 * GRID));
        for (a, b) in chunks {
            let product =
                |a: &[i16], b: &[i16]| a.iter().zip(b).map(|(&a, &b)| i64::from(a) * i64::from(b)).sum::<i64>() as f64;
            aa += product(a, a);
            bb += product(b, b);
            ab += product(a, b);
            if ab < 0.9 * (aa * bb).sqrt() {
                return false;
            }
        }
        let least = LEAST_ENERGY * self.differences.len() as f64;
        aa > least && bb > least && ab > SAME * (aa * bb).sqrt()
    }
}
