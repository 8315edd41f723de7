//! Score of the fused image against the slices: how well it preserves the detail of the sharpest slice, block by block.
//!
//! The published metrics sum over all sources, which rewards blur when there are many slices, because most of them are
//! blurred at any pixel. Here each pixel (or 8x8 window) is compared with its sharpest slice alone. Slices are streamed
//! through a [`Scorer`], so that memory per block does not grow with their number.

mod gradients;
mod windows;

use super::deterministic_sum;
use crate::{imaging::Plane, types::metrics::FusionMetrics};

use gradients::Gradients;
pub(super) use gradients::sobel;
use windows::Windows;

/// A pixel of the fused image overshoots if it is more than this outside the range of the slices, grey levels.
const OVERSHOOT_LEVELS: f32 = 1.0;

/// Sums over the pixels of one or more blocks. Merged in the order of the blocks, they do not depend on the threads.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ScoreSums {
    /// Gradient preservation times the gradient of the sharpest slice; that gradient.
    q_g: Ratio,
    /// Quality index times the variance of the sharpest slice; that variance.
    q_w: Ratio,
    /// Gradient energy of the fused image; that of the sharpest slice per pixel.
    retention: Ratio,
    /// Squared differences to the right neighbour; their number.
    right: Ratio,
    /// Squared differences to the lower neighbour; their number.
    below: Ratio,
    /// Squared Sobel gradients of the fused image; their number.
    tenengrad: Ratio,
    /// Laplacians of the fused image; their number.
    laplacian: Ratio,
    /// Squared Laplacians; their number.
    laplacian_squares: Ratio,
    /// Pixels that overshoot the range of the slices; all pixels.
    overshoot: Ratio,
    /// Grey levels outside the range of the slices; all pixels.
    overshoot_levels: Ratio,
    /// Clipped pixels of the fused image; all pixels.
    clipped: Ratio,
    /// Grey levels of the fused image; all pixels.
    level: Ratio,
}

/// Numerator and denominator of a ratio, which are summed separately.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Ratio {
    numerator: f64,
    denominator: f64,
}

impl Ratio {
    fn add(&mut self, numerator: f64, denominator: f64) {
        self.numerator += numerator;
        self.denominator += denominator;
    }

    /// The quotient; none without a positive denominator.
    fn quotient(self) -> Option<f64> {
        (self.denominator > 0.0).then(|| self.numerator / self.denominator).filter(|ratio| ratio.is_finite())
    }
}

impl ScoreSums {
    /// Adds the sums of the next block.
    pub fn merge(&mut self, next: &Self) {
        let mut next = *next;
        for (sum, more) in self.ratios().into_iter().zip(next.ratios()) {
            sum.add(more.numerator, more.denominator);
        }
    }

    fn ratios(&mut self) -> [&mut Ratio; 12] {
        let Self {
            q_g,
            q_w,
            retention,
            right,
            below,
            tenengrad,
            laplacian,
            laplacian_squares,
            overshoot,
            overshoot_levels,
            clipped,
            level,
        } = self;
        [
            q_g,
            q_w,
            retention,
            right,
            below,
            tenengrad,
            laplacian,
            laplacian_squares,
            overshoot,
            overshoot_levels,
            clipped,
            level,
        ]
    }

    /// The metrics; none where nothing could be measured.
    pub fn metrics(&self) -> FusionMetrics {
        let spatial_frequency = match (self.right.quotient(), self.below.quotient()) {
            (Some(right), Some(below)) => Some((right + below).sqrt()),
            _ => None,
        };
        let laplacian_variance = match (self.laplacian.quotient(), self.laplacian_squares.quotient()) {
            (Some(mean), Some(mean_square)) => Some((mean_square - mean * mean).max(0.0)),
            _ => None,
        };
        FusionMetrics {
            q_g_top: self.q_g.quotient(),
            q_w_top: self.q_w.quotient(),
            sharpness_retention: self.retention.quotient(),
            spatial_frequency,
            tenengrad: self.tenengrad.quotient(),
            laplacian_variance,
            overshoot_fraction: self.overshoot.quotient(),
            overshoot_levels: self.overshoot_levels.quotient(),
            clipped_fraction: self.clipped.quotient(),
            mean_level: self.level.quotient(),
        }
    }
}

/// Scores one block, slice by slice.
///
/// Neighbourhoods (3x3 for gradients, 8x8 for windows) lie entirely inside the block and inside the part that a slice
/// covers. With an object mask a gradient counts if its pixel belongs to the object, a window if all its pixels do.
#[derive(Debug)]
pub struct Scorer<'a> {
    fused: &'a Plane<f32>,
    object: Option<&'a Plane<u8>>,
    gradients: Gradients,
    windows: Windows,
    lowest: Vec<f32>,
    highest: Vec<f32>,
}

impl<'a> Scorer<'a> {
    /// A scorer for one block. `fused` is the luma (0..255) of the fused image as it is written; `object` (255 inside,
    /// 0 outside) restricts the score to the object and is ignored if it has another size.
    pub fn new(fused: &'a Plane<f32>, object: Option<&'a Plane<u8>>) -> Self {
        let object = object.filter(|object| same_shape(object, fused));
        let pixels = fused.data.len();
        Self {
            fused,
            object,
            gradients: Gradients::new(fused.width, fused.height),
            windows: Windows::new(fused),
            lowest: vec![f32::INFINITY; pixels],
            highest: vec![f32::NEG_INFINITY; pixels],
        }
    }

    /// Adds the next slice, in ascending order: its warped luma (0..255) and validity (255 valid; none if the slice
    /// covers the whole block). Planes of another size than `fused` are ignored.
    pub fn slice(&mut self, luma: &Plane<f32>, valid: Option<&Plane<u8>>) {
        if !same_shape(luma, self.fused) || valid.is_some_and(|valid| !same_shape(valid, self.fused)) {
            return;
        }
        let holes = valid.filter(|valid| valid.data.contains(&0));
        let range = self.lowest.iter_mut().zip(&mut self.highest).zip(&luma.data);
        match holes {
            None => range.for_each(|((low, high), &value)| {
                *low = if value < *low { value } else { *low };
                *high = if value > *high { value } else { *high };
            }),
            Some(valid) => range.zip(&valid.data).for_each(|(((low, high), &value), &covered)| {
                *low = if covered != 0 && value < *low { value } else { *low };
                *high = if covered != 0 && value > *high { value } else { *high };
            }),
        }
        self.gradients.slice(luma, holes);
        self.windows.slice(luma, holes);
    }

    /// The sums over the block.
    pub fn sums(self) -> ScoreSums {
        let covered = PixelWeights::of(self.fused, |i| self.highest[i] > f32::NEG_INFINITY);
        let counts = match self.object {
            None => covered.clone(),
            Some(object) => {
                PixelWeights::of(self.fused, |i| self.highest[i] > f32::NEG_INFINITY && object.data[i] != 0)
            }
        };
        let mut sums = ScoreSums::default();
        self.gradients.sum(self.fused, &counts, &covered, &mut sums);
        self.windows.sum(&counts, &mut sums);
        differences(self.fused, &counts, &mut sums);
        self.range(&counts, &mut sums);
        sums
    }

    /// Sums the overshoot beyond the range of the slices, clipped pixels, and grey levels.
    fn range(&self, counts: &PixelWeights, sums: &mut ScoreSums) {
        let width = self.fused.width;
        let (mut beyond, mut outside, mut clipped) = (vec![0.0; width], vec![0.0; width], vec![0.0; width]);
        for y in 0..self.fused.height {
            let row = y * width..(y + 1) * width;
            let range = self.lowest[row.clone()].iter().zip(&self.highest[row]);
            let out = beyond.iter_mut().zip(&mut outside).zip(&mut clipped);
            for (((beyond, outside), clipped), (&value, (&low, &high))) in out.zip(self.fused.row(y).iter().zip(range))
            {
                let over = if value > high { value - high } else { 0.0 };
                let under = if value < low { low - value } else { 0.0 };
                // without any slice both bounds are infinite, and 0 (the weight) times infinity is NaN
                let both = (over + under).min(255.0);
                *beyond = both;
                *outside = if both > OVERSHOOT_LEVELS { 1.0 } else { 0.0 };
                *clipped = if (super::ZERO..super::FULL).contains(&value) { 0.0 } else { 1.0 };
            }
            let weights = counts.weights.row(y);
            let count = deterministic_sum::sum(weights);
            sums.overshoot.add(deterministic_sum::dot(&outside, weights), count);
            sums.overshoot_levels.add(deterministic_sum::dot(&beyond, weights), count);
            sums.clipped.add(deterministic_sum::dot(&clipped, weights), count);
            sums.level.add(deterministic_sum::dot(self.fused.row(y), weights), count);
        }
    }
}

/// The pixels of a block that count: weight 1, others 0.
#[derive(Debug, Clone)]
struct PixelWeights {
    weights: Plane<f32>,
    /// Whether all pixels count.
    all: bool,
}

impl PixelWeights {
    fn of(shape: &Plane<f32>, counts: impl Fn(usize) -> bool) -> Self {
        let data: Vec<f32> = (0..shape.data.len()).map(|i| if counts(i) { 1.0 } else { 0.0 }).collect();
        let all = !data.contains(&0.0);
        Self { weights: Plane { width: shape.width, height: shape.height, data }, all }
    }

    /// Per upper left corner of a `side` x `side` neighbourhood: 1 if all its pixels count, else 0; `side - 1` smaller.
    fn whole_neighbourhoods(&self, side: usize) -> Plane<f32> {
        let (width, height) = (self.weights.width, self.weights.height);
        if width < side || height < side {
            return Plane::default();
        }
        if self.all {
            return Plane::filled(width + 1 - side, height + 1 - side, 1.0);
        }
        let bytes = self.weights.map(|weight| if weight > 0.0 { 255u8 } else { 0 });
        whole_neighbourhoods(&bytes, side).map(|whole| if whole != 0 { 1.0 } else { 0.0 })
    }
}

pub(super) fn same_shape<A, B>(a: &Plane<A>, b: &Plane<B>) -> bool {
    a.width == b.width && a.height == b.height && a.data.len() == b.data.len()
}

/// Sums the squared differences to the right and lower neighbours, where both pixels count.
fn differences(fused: &Plane<f32>, counts: &PixelWeights, sums: &mut ScoreSums) {
    if fused.width == 0 {
        return;
    }
    let (mut squares, mut weights) = (vec![0.0f32; fused.width], vec![0.0f32; fused.width]);
    let mut squared = |(a, wa): (&[f32], &[f32]), (b, wb): (&[f32], &[f32]), ratio: &mut Ratio| {
        let length = a.len();
        for ((square, a), b) in squares.iter_mut().zip(a).zip(b) {
            *square = (a - b) * (a - b);
        }
        for ((weight, a), b) in weights.iter_mut().zip(wa).zip(wb) {
            *weight = a * b;
        }
        ratio.add(
            deterministic_sum::dot(&squares[..length], &weights[..length]),
            deterministic_sum::sum(&weights[..length]),
        );
    };
    let last = fused.width - 1;
    for y in 0..fused.height {
        let (row, here) = (fused.row(y), counts.weights.row(y));
        squared((&row[..last], &here[..last]), (&row[1..], &here[1..]), &mut sums.right);
        if y + 1 < fused.height {
            squared((row, here), (fused.row(y + 1), counts.weights.row(y + 1)), &mut sums.below);
        }
    }
}

/// Per upper left corner of a `side` x `side` neighbourhood: 255 if all its pixels are non-zero, else 0. The result is
/// `side - 1` smaller in width and height, and empty if the plane is too small.
pub(super) fn whole_neighbourhoods(counts: &Plane<u8>, side: usize) -> Plane<u8> {
    if counts.width < side || counts.height < side {
        return Plane::default();
    }
    let (width, height) = (counts.width + 1 - side, counts.height + 1 - side);
    let mut across = Plane::filled(width, counts.height, 255u8);
    for y in 0..counts.height {
        let row = counts.row(y);
        for k in 0..side {
            across.row_mut(y).iter_mut().zip(&row[k..]).for_each(|(all, &c)| *all &= c);
        }
    }
    let mut whole = Plane::filled(width, height, 255u8);
    for y in 0..height {
        for k in 0..side {
            whole.row_mut(y).iter_mut().zip(across.row(y + k)).for_each(|(all, &c)| *all &= c);
        }
    }
    whole
}

#[cfg(test)]
mod tests;
