//! Slices that differ alone: whose own dots contradict the model of the stack at the image corners.
//!
//! The model is selected by means over the slices, in which one slice of many hardly counts, and the residuals of the
//! dots hardly show a tilt where the dots cover a part of the image. So each slice is compared by itself: its own
//! homography with its estimate under the model, at the corners.
//!
//! A few slices that no similarity fits would also make the model of all slices more complex than the others need. So
//! those are looked for first.

use super::estimates::{Estimate, Setting, predicted_without};
use super::inliers::{Inliers, own_estimates};
use crate::calibration::rail::{EstimateSource, OwnEstimate};
use crate::calibration::transform_models::TransformModel;
use crate::types::Homography;

/// Least distance of the corners from which a slice differs, px: at three times less a calibration may be good.
const LEAST: f64 = 0.1;
/// Standard deviations of its own homography that a slice must be away from the model.
const CLEAR: f64 = 4.0;
/// Standard deviations of the distance that chance explains.
const CHANCE: f64 = 2.0;

/// Share of the slices, as a divisor, up to which those that no similarity fits are the exception.
const FEW: usize = 4;

/// How far a slice is from the model of the stack.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deviation {
    /// Largest distance of a corner, px.
    apart: f64,
    /// Its standard deviation, px.
    sigma: f64,
}

impl Deviation {
    /// True when the slice differs.
    pub(super) fn is_clear(self) -> bool {
        self.apart > LEAST && self.apart > CLEAR * self.sigma
    }

    /// The same when the other homography has a standard deviation, too.
    fn with(self, sigma: f64) -> Self {
        Self { sigma: self.sigma.hypot(sigma), ..self }
    }

    /// The part of the distance that chance does not explain, px.
    pub(super) fn unexplained(self) -> f64 {
        (self.apart.powi(2) - (CHANCE * self.sigma).powi(2)).max(0.0).sqrt()
    }
}

/// The homography of each slice from its own dots alone, and the standard deviation of its worst corner, px; `None`
/// where they do not determine it.
pub(super) struct OwnHomographies<'a> {
    inliers: &'a [Inliers],
    all: Vec<Option<(Homography, f64)>>,
}

impl<'a> OwnHomographies<'a> {
    pub(super) fn of(inliers: &'a [Inliers], s: &Setting) -> Self {
        Self { inliers, all: by_dots(TransformModel::Homography, inliers, 0, s) }
    }

    /// How far slice `index` is from another homography; `None` for the reference slice, and where its dots do not
    /// determine a homography.
    pub(super) fn deviation(&self, index: usize, other: &Homography, s: &Setting) -> Option<Deviation> {
        let (own, sigma) = self.all[index].filter(|_| index != s.reference)?;
        Some(Deviation { apart: s.apart(&own, other), sigma })
    }

    /// True when so many of the slices are the exception.
    pub(super) fn are_few(&self, slices: usize) -> bool {
        FEW * slices <= self.all.iter().flatten().count()
    }

    /// The few slices that no similarity fits and that do not follow the rail law of the others; none when they are not
    /// few. The others scatter about their law, too, each about that of the rest.
    pub(super) fn bent(&self, s: &Setting) -> Vec<usize> {
        let similar = by_dots(TransformModel::Similarity, self.inliers, 0, s);
        let differs = |i: usize, (from, sigma): (Homography, f64)| {
            self.deviation(i, &from, s).is_some_and(|deviation| deviation.with(sigma).is_clear())
        };
        let is_bent = |i: &usize| similar[*i].is_some_and(|(own, _)| differs(*i, (own, 0.0)));
        let mut bent: Vec<usize> = (0..self.all.len()).filter(is_bent).collect();
        if bent.is_empty() || !self.are_few(bent.len()) {
            return Vec::new();
        }
        let law = predicted_without(&bent, self.inliers, s);
        let apart = |i: usize| Some(self.deviation(i, law[i].as_ref()?, s)?.apart);
        let others: Vec<f64> = (0..law.len()).filter(|i| !bent.contains(i)).filter_map(apart).collect();
        let scatter = (others.iter().map(|d| d * d).sum::<f64>() / others.len().max(1) as f64).sqrt();
        bent.retain(|&i| law[i].is_some_and(|law| differs(i, (law, scatter))));
        bent
    }

    /// The estimate of slice `index` alone, with the model that has the least expected error at the corners.
    /// `estimate`: under the model of the stack.
    pub(super) fn alone(&self, index: usize, estimate: &Estimate, s: &Setting) -> Option<Estimate> {
        let (full, full_sigma) = self.all[index]?;
        let risk = |model: TransformModel| {
            let (own, sigma) = by_dots(model, &self.inliers[index..=index], index, s)[0]?;
            let noise = 1.7 * (full_sigma.powi(2) - sigma.powi(2)).max(0.0);
            let bias = (s.apart(&own, &full).powi(2) - noise).max(0.0);
            Some((own, (sigma.powi(2) + bias).sqrt()))
        };
        let simple = [TransformModel::Similarity, TransformModel::Affine].into_iter().filter_map(risk);
        let (homography, sigma) = simple.chain([(full, full_sigma)]).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let off_law = estimate.by_law.map(|law| s.apart(&law, &homography));
        Some(Estimate { homography, sigma, off_law, source: EstimateSource::Dots, ..*estimate })
    }
}

/// The transforms of slices under a model by their own dots alone, and the standard deviation of the worst corner, px.
/// `first`: index of the first of them.
fn by_dots(model: TransformModel, inliers: &[Inliers], first: usize, s: &Setting) -> Vec<Option<(Homography, f64)>> {
    let own = own_estimates(model, inliers, s.reference.wrapping_sub(first), &s.frame, s.size);
    let map = |(index, own): (usize, Option<OwnEstimate>)| {
        let own = own?;
        let homography = s.frame.homography(&model.parameters(&own.free))?;
        Some((homography, s.corner_sigma(model, &own).hypot(s.floors[first + index])))
    };
    own.into_iter().enumerate().map(map).collect()
}
