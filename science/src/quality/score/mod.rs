//! How well the fused image keeps what the sharpest slice shows, block by block.
//!
//! The published sums over all sources reward blur when there are many slices; here each pixel (or window)
//! is compared with its sharpest slice alone. Memory per block does not grow with the number of slices.

mod gradients;
mod windows;

use super::deterministic_sum;
use crate::{imaging::Plane, types::metrics::FusionMetrics};

use gradients::Gradients;
pub(super) use gradients::sobel;
use windows::Windows;

/// How far outside the range of the slices a pixel of the fused image counts as overshoot, grey levels.
const OVERSHOOT_LEVELS: f32 = 1.0;

/// ScoreSums over the pixels of one or more blocks; merged in the order of the blocks they are the same
/// whatever thread scored which block.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ScoreSums {
    /// Sum of gradient preservation times the gradient of the sharpest slice, and of that gradient alone.
    q_g: Ratio,
    /// Sum of the quality index times the variance of the sharpest slice, and of that variance alone.
    q_w: Ratio,
    /// Gradient energy of the fused image, and of the sharpest slice per pixel.
    retention: Ratio,
    /// Squared differences to the right neighbour, and their number.
    right: Ratio,
    /// Squared differences to the lower neighbour, and their number.
    below: Ratio,
    /// Squared Sobel gradients of the fused image, and their number.
    tenengrad: Ratio,
    /// Laplacians of the fused image, and their number.
    laplacian: Ratio,
    /// Their squares, and their number.
    laplacian_squares: Ratio,
    /// Pixels outside the range of the slices, and pixels looked at.
    overshoot: Ratio,
    /// Grey levels outside the range of the slices, and pixels looked at.
    overshoot_levels: Ratio,
    /// Pixels of the fused image at full scale or at zero, and pixels looked at.
    clipped: Ratio,
}

/// A numerator and a denominator.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Ratio {
    above: f64,
    below: f64,
}

impl Ratio {
    fn add(&mut self, above: f64, below: f64) {
        self.above += above;
        self.below += below;
    }

    /// The ratio, when there is one.
    fn ratio(self) -> Option<f64> {
        (self.below > 0.0).then(|| self.above / self.below).filter(|ratio| ratio.is_finite())
    }
}

impl ScoreSums {
    /// Adds the sums of the next block.
    pub fn merge(&mut self, next: &Self) {
        let mut next = *next;
        for (sum, more) in self.shares().into_iter().zip(next.shares()) {
            sum.add(more.above, more.below);
        }
    }

    fn shares(&mut self) -> [&mut Ratio; 11] {
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
        ]
    }

    /// The numbers; none where nothing could be measured.
    pub fn metrics(&self) -> FusionMetrics {
        let spatial_frequency = match (self.right.ratio(), self.below.ratio()) {
            (Some(right), Some(below)) => Some((right + below).sqrt()),
            _ => None,
        };
        let laplacian_variance = match (self.laplacian.ratio(), self.laplacian_squares.ratio()) {
            (Some(mean), Some(mean_square)) => Some((mean_square - mean * mean).max(0.0)),
            _ => None,
        };
        FusionMetrics {
            q_g_top: self.q_g.ratio(),
            q_w_top: self.q_w.ratio(),
            sharpness_retention: self.retention.ratio(),
            spatial_frequency,
            tenengrad: self.tenengrad.ratio(),
            laplacian_variance,
            overshoot_fraction: self.overshoot.ratio(),
            overshoot_levels: self.overshoot_levels.ratio(),
            clipped_fraction: self.clipped.ratio(),
        }
    }
}

/// Scores one block: `fused` is the luma (0..255) of the fused image as it is written, `slices` yields, in
/// ascending order, luma (0..255) and validity (255 valid; none where all of it is) of every warped slice that covers
/// part of exactly the same block, `object` (0 or 255) restricts the score to the object.
///
/// Neighbourhoods (3x3 for gradients, 8x8 for windows) lie wholly inside the block and inside what the slice
/// covers. A gradient counts where its pixel is of the object, a window where all of it is.
/// Planes of another size than `fused` are passed over.
pub fn score(
    fused: &Plane<f32>,
    slices: &mut dyn Iterator<Item = (Plane<f32>, Option<Plane<u8>>)>,
    object: Option<&Plane<u8>>,
) -> ScoreSums {
    let mut scorer = Scorer::new(fused, object);
    for (luma, valid) in slices {
        scorer.slice(&luma, valid.as_ref());
    }
    scorer.sums()
}

/// [`score`], slice by slice, for callers that reuse their buffers.
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
    /// A scorer of one block: see [`score`].
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

    /// Takes the next slice: luma 0..255 and validity (255 valid; none when the slice covers all of it) on the block.
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

    /// What lies outside the range of the slices, and what is clipped.
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
                // where nothing is covered both bounds are infinite; the weight is 0, and 0 times infinity is not
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
        }
    }
}

/// Which pixels of a block count: weights of 1, or 0.
#[derive(Debug, Clone)]
struct PixelWeights {
    weights: Plane<f32>,
    /// Whether all of them do.
    all: bool,
}

impl PixelWeights {
    fn of(shape: &Plane<f32>, counts: impl Fn(usize) -> bool) -> Self {
        let data: Vec<f32> = (0..shape.data.len()).map(|i| if counts(i) { 1.0 } else { 0.0 }).collect();
        let all = !data.contains(&0.0);
        Self { weights: Plane { width: shape.width, height: shape.height, data }, all }
    }

    /// Per upper left corner of a `side` x `side` neighbourhood: 1 where all of it counts; `side - 1` smaller.
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

/// ScoreSums the squared differences to the right and lower neighbours, where both pixels count.
fn differences(fused: &Plane<f32>, counts: &PixelWeights, sums: &mut ScoreSums) {
    if fused.width == 0 {
        return;
    }
    let (mut squares, mut weights) = (vec![0.0f32; fused.width], vec![0.0f32; fused.width]);
    let mut squared = |(a, wa): (&[f32], &[f32]), (b, wb): (&[f32], &[f32]), share: &mut Ratio| {
        let length = a.len();
        for ((square, a), b) in squares.iter_mut().zip(a).zip(b) {
            *square = (a - b) * (a - b);
        }
        for ((weight, a), b) in weights.iter_mut().zip(wa).zip(wb) {
            *weight = a * b;
        }
        share.add(
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

/// For every pixel, whether the whole `side` x `side` neighbourhood whose upper left corner it is counts
/// (non-zero); the result is `side - 1` smaller in width and height. Empty when the plane is too small.
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
