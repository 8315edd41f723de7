//! How well the fused image keeps what the sharpest slice shows, tile by tile.
//!
//! The published sums over all sources reward blur when there are many slices; here each pixel (or window)
//! is compared with its sharpest slice alone. Memory per tile does not grow with the number of slices.

mod gradients;
mod windows;

use crate::{imaging::Plane, model::metrics::FusionMetrics};

use gradients::Gradients;
pub(super) use gradients::sobel;
use windows::Windows;

/// Sums over the pixels of one or more tiles; merged in the order of the tiles they are the same
/// whatever thread scored which tile.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sums {
    /// Sum of gradient preservation times the gradient of the sharpest slice, and of that gradient alone.
    q_g: Share,
    /// Sum of the quality index times the variance of the sharpest slice, and of that variance alone.
    q_w: Share,
    /// Gradient energy of the fused image, and of the sharpest slice per pixel.
    retention: Share,
    /// Squared differences to the right neighbour, and their number.
    right: Share,
    /// Squared differences to the lower neighbour, and their number.
    below: Share,
    /// Squared Sobel gradients of the fused image, and their number.
    tenengrad: Share,
    /// Laplacians of the fused image, and their number.
    laplacian: Share,
    /// Their squares, and their number.
    laplacian_squares: Share,
    /// Pixels outside the range of the slices, and pixels looked at.
    overshoot: Share,
}

/// A numerator and a denominator.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Share {
    above: f64,
    below: f64,
}

impl Share {
    fn add(&mut self, above: f64, below: f64) {
        self.above += above;
        self.below += below;
    }

    /// The ratio, when there is one.
    fn ratio(self) -> Option<f64> {
        (self.below > 0.0).then(|| self.above / self.below).filter(|ratio| ratio.is_finite())
    }
}

impl Sums {
    /// Adds the sums of the next tile.
    pub fn merge(&mut self, next: &Self) {
        let mut next = *next;
        for (sum, more) in self.shares().into_iter().zip(next.shares()) {
            sum.add(more.above, more.below);
        }
    }

    fn shares(&mut self) -> [&mut Share; 9] {
        let Self { q_g, q_w, retention, right, below, tenengrad, laplacian, laplacian_squares, overshoot } = self;
        [q_g, q_w, retention, right, below, tenengrad, laplacian, laplacian_squares, overshoot]
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
        }
    }
}

/// Scores one tile: `fused` is the luma (0..255) of the fused image as it is written, `slices` yields, in
/// ascending order, luma (0..255) and validity (255 valid) of every warped slice that covers part of
/// exactly the same tile, `object` (0 or 255) restricts the score to the object.
///
/// Neighbourhoods (3x3 for gradients, 8x8 for windows) lie wholly inside the tile and inside what the slice
/// covers. A gradient counts where its pixel is of the object, a window where all of it is.
/// Planes of another size than `fused` are passed over.
pub fn score(
    fused: &Plane<f32>,
    slices: &mut dyn Iterator<Item = (Plane<f32>, Plane<u8>)>,
    object: Option<&Plane<u8>>,
) -> Sums {
    let mut scorer = Scorer::new(fused, object);
    for (luma, valid) in slices {
        scorer.slice(&luma, &valid);
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
    /// A scorer of one tile: see [`score`].
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

    /// Takes the next slice: luma 0..255 and validity (255 valid) on the tile.
    pub fn slice(&mut self, luma: &Plane<f32>, valid: &Plane<u8>) {
        if !same_shape(luma, self.fused) || !same_shape(valid, self.fused) {
            return;
        }
        let covered_everywhere = valid.data.iter().all(|&v| v != 0);
        let holes = (!covered_everywhere).then_some(valid);
        for i in 0..luma.data.len() {
            let value = luma.data[i];
            let covered = valid.data[i] != 0;
            self.lowest[i] = if covered && value < self.lowest[i] { value } else { self.lowest[i] };
            self.highest[i] = if covered && value > self.highest[i] { value } else { self.highest[i] };
        }
        self.gradients.slice(luma, holes);
        self.windows.slice(self.fused, luma, holes);
    }

    /// The sums over the tile.
    pub fn sums(self) -> Sums {
        let covered = Plane {
            width: self.fused.width,
            height: self.fused.height,
            data: self.highest.iter().map(|&high| if high > f32::NEG_INFINITY { 255u8 } else { 0 }).collect(),
        };
        let counts = match self.object {
            None => covered.clone(),
            Some(object) => {
                let mut both = covered.clone();
                both.data.iter_mut().zip(&object.data).for_each(|(c, &o)| *c = if o == 0 { 0 } else { *c });
                both
            }
        };
        let mut sums = Sums::default();
        self.gradients.sum(self.fused, &counts, &covered, &mut sums);
        self.windows.sum(&counts, &mut sums);
        differences(self.fused, &counts, &mut sums);
        for (i, &value) in self.fused.data.iter().enumerate().filter(|&(i, _)| counts.data[i] != 0) {
            let outside = value > self.highest[i] + OVERSHOOT_LEVELS || value < self.lowest[i] - OVERSHOOT_LEVELS;
            sums.overshoot.add(f64::from(u8::from(outside)), 1.0);
        }
        sums
    }
}

/// How far outside the range of the slices a pixel of the fused image counts as overshoot, grey levels.
const OVERSHOOT_LEVELS: f32 = 1.0;

pub(super) fn same_shape<A, B>(a: &Plane<A>, b: &Plane<B>) -> bool {
    a.width == b.width && a.height == b.height && a.data.len() == b.data.len()
}

/// Sums the squared differences to the right and lower neighbours, where both pixels count.
fn differences(fused: &Plane<f32>, counts: &Plane<u8>, sums: &mut Sums) {
    let squared = |a: f32, b: f32| f64::from((a - b) * (a - b));
    for y in 0..fused.height {
        let (row, here) = (fused.row(y), counts.row(y));
        for x in 1..fused.width {
            if here[x - 1] & here[x] != 0 {
                sums.right.add(squared(row[x - 1], row[x]), 1.0);
            }
        }
        if y + 1 == fused.height {
            break;
        }
        let (below, there) = (fused.row(y + 1), counts.row(y + 1));
        for x in 0..fused.width {
            if here[x] & there[x] != 0 {
                sums.below.add(squared(row[x], below[x]), 1.0);
            }
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
    let mut across = Plane::filled(width, counts.height, 0u8);
    for y in 0..counts.height {
        let row = counts.row(y);
        for (x, out) in across.row_mut(y).iter_mut().enumerate() {
            *out = row[x..x + side].iter().fold(255, |all, &c| all & c);
        }
    }
    let mut whole = Plane::filled(width, height, 0u8);
    for y in 0..height {
        for x in 0..width {
            whole.data[y * width + x] = (y..y + side).fold(255, |all, row| all & across.at(x, row));
        }
    }
    whole
}

#[cfg(test)]
mod tests;
