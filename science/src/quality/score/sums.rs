//! The sums of the scores of blocks, and the metrics that they give.

use crate::types::metrics::FusionMetrics;

/// Sums over the pixels of one or more blocks. Merged in the order of the blocks, they do not depend on the threads.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ScoreSums {
    /// Gradient preservation times the gradient of the sharpest slice; that gradient.
    pub(super) q_g: Ratio,
    /// Quality index times the variance of the sharpest slice; that variance.
    pub(super) q_w: Ratio,
    /// Gradient energy of the fused image; that of the sharpest slice per pixel.
    pub(super) retention: Ratio,
    /// Squared differences to the right neighbour; their number.
    pub(super) right: Ratio,
    /// Squared differences to the lower neighbour; their number.
    pub(super) below: Ratio,
    /// Squared Sobel gradients of the fused image; their number.
    pub(super) tenengrad: Ratio,
    /// Laplacians of the fused image; their number.
    pub(super) laplacian: Ratio,
    /// Squared Laplacians; their number.
    pub(super) laplacian_squares: Ratio,
    /// Pixels that overshoot the range of the slices; all pixels.
    pub(super) overshoot: Ratio,
    /// Grey levels outside the range of the slices; all pixels.
    pub(super) overshoot_levels: Ratio,
    /// Clipped pixels of the fused image; all pixels.
    pub(super) clipped: Ratio,
    /// Grey levels of the fused image; all pixels.
    pub(super) level: Ratio,
}

/// Numerator and denominator of a ratio, which are summed separately.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Ratio {
    numerator: f64,
    denominator: f64,
}

impl Ratio {
    pub(super) fn add(&mut self, numerator: f64, denominator: f64) {
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
