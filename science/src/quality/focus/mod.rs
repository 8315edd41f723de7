//! Coverage in depth: whether the slices sample the whole depth of the object densely enough.
//!
//! Input: the focus measure (saliency) of every slice at a sparse grid of points, and the decision map. A point is
//! textured if its saliency exceeds the [`noise_floor`] in some slice; only textured points say anything about depth.
//!
//! All conclusions use one model: with defocus `z`, saliency falls about as `s(z) = s0 / (1 + (z / w)^2)`.

mod curve;
mod label_noise;
mod noise_floor;
mod range;
mod unfocused_area;

use super::{focus_order::FocusCurves, sampling::Points, slice::SliceMeasurements};
use crate::{
    imaging::{Plane, statistics},
    types::metrics::FocusMetrics,
};

/// With fewer textured samples nothing is said about single slices.
const LEAST_TEXTURED: usize = 200;
/// An inner slice is redundant if it contributes a smaller share of the textured pixels than this ...
const REDUNDANT: f64 = 0.002;
/// ... and, in long stacks, than this part of the mean contribution of a slice.
const REDUNDANT_OF_MEAN: f64 = 0.1;
/// Gap: saliency of texture that is sharp in one slice falls below this share in the next, and the other way round. By
/// the model, texture halfway between them is then less than 0.7 as sharp as in focus: 1 / (1 + (1 / 0.37 - 1) / 4) =
/// 0.70.
const GAP: f32 = 0.37;
/// A step is uneven if it is this many times the median step ...
const UNEVEN: f32 = 1.7;
/// ... and saliency falls below this share over it.
const UNEVEN_FALL: f32 = 0.6;
/// At an end the peak is estimated from slices about this far apart, in units of the width `w` of the model. Closer
/// slices differ by little more than noise, and the peak of a part in focus at the end seems to lie beyond it.
const APART: f32 = 0.5;
/// With fewer pairs of neighbours there is no median step.
const LEAST_FOR_USUAL: usize = 4;
/// With fewer pixels on either side nothing is said about a gap.
const LEAST_FOR_GAP: usize = 30;
/// Only texture this many times above the noise floor shows how deep the valley between two slices is.
const STRONG: f32 = 2.0;

/// Decision map of a fusion: the slice that each pixel is taken from.
#[derive(Debug, Clone, Copy)]
pub struct DecisionMap<'a> {
    /// 0-based index of the slice; `u16::MAX` where no slice covers the pixel.
    pub index: &'a Plane<u16>,
    /// Whether the labels are final decisions: true when fusion corrected doubtful labels from their surroundings,
    /// false when each label is the slice with the highest focus measure at that pixel alone. Defocus spread of near
    /// parts puts more wrong labels into a map that is not refined, so thresholds on it are higher.
    pub refined: bool,
}

/// Coverage in depth, and the contribution of every slice.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct DepthCoverage {
    pub(super) metrics: FocusMetrics,
    pub(super) contribution: Vec<Option<f64>>,
    /// Per pair of neighbours: how far focus moves, in units of the median step.
    pub(super) steps: Vec<Option<f32>>,
}

/// The samples that count: the points that some slice covers and, with a mask, that belong to the object.
struct Samples {
    /// Saliency, sample by sample and within a sample by slice; 0 where a slice does not cover.
    saliency: Vec<f32>,
    /// Per sample: its label, the slice of the decision map.
    labels: Vec<usize>,
    /// Per sample: its position (x, y).
    at: Vec<(usize, usize)>,
    slices: usize,
}

impl Samples {
    fn of(measurements: &[SliceMeasurements], points: &Points, index: &Plane<u16>) -> Self {
        let slices = measurements.len();
        let mut samples = Self { saliency: Vec::new(), labels: Vec::new(), at: Vec::new(), slices };
        for (i, (x, y)) in points.positions().enumerate() {
            if x >= index.width || y >= index.height {
                continue;
            }
            let label = usize::from(index.at(x, y));
            if label >= slices {
                continue;
            }
            samples.labels.push(label);
            samples.at.push((x, y));
            let value =
                |slice: &SliceMeasurements| slice.saliency.get(i).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
            samples.saliency.extend(measurements.iter().map(value));
        }
        samples
    }

    /// Per sample: its label and the saliency of every slice.
    fn each(&self) -> impl Iterator<Item = (usize, &[f32])> {
        self.labels.iter().copied().zip(self.saliency.chunks_exact(self.slices))
    }
}

/// Measures the coverage in depth. `measurements` are in the order of the slices; `masked` says that the points are
/// those of the object alone.
pub(super) fn measure(
    measurements: &[SliceMeasurements],
    points: &Points,
    decision_map: &DecisionMap<'_>,
    masked: bool,
) -> DepthCoverage {
    let index = decision_map.index;
    let slices = measurements.len();
    let unknown = DepthCoverage { contribution: vec![None; slices], ..DepthCoverage::default() };
    let samples = Samples::of(measurements, points, index);
    if samples.labels.is_empty() {
        return unknown;
    }
    let floor = noise_floor::measure(&samples.saliency);
    let is_textured: Vec<bool> =
        samples.each().map(|(_, saliency)| saliency.iter().any(|&value| value > floor)).collect();
    let textured: Vec<(usize, &[f32])> =
        samples.each().zip(&is_textured).filter(|(_, textured)| **textured).map(|(sample, _)| sample).collect();
    let share = textured.len() as f64 / samples.labels.len() as f64;
    let mut metrics = FocusMetrics {
        textured_fraction: Some(share),
        unfocused_fraction: masked.then_some(1.0 - share),
        unfocused_area: if masked {
            unfocused_area::largest(points, &samples.at, &is_textured, (index.width, index.height))
        } else {
            None
        },
        ..FocusMetrics::default()
    };
    if textured.len() < LEAST_TEXTURED {
        return DepthCoverage { metrics, ..unknown };
    }
    let at: Vec<(usize, usize)> =
        samples.at.iter().zip(&is_textured).filter(|(_, textured)| **textured).map(|(&at, _)| at).collect();
    let mut counts = vec![0usize; slices];
    textured.iter().for_each(|&(label, _)| counts[label] += 1);
    let contribution: Vec<f64> = counts.iter().map(|&count| count as f64 / textured.len() as f64).collect();
    metrics.redundant_slices = redundant(&contribution);
    let falls = falls(&textured, floor, slices);
    let steps = steps(&falls);
    let pairs = |wanted: &dyn Fn(usize) -> bool| (0..falls.len()).filter(|&n| wanted(n)).map(|n| n as u32).collect();
    metrics.coverage_gaps = pairs(&|n| falls[n].is_some_and(|fall| fall < GAP));
    metrics.uneven_steps =
        pairs(&|n| steps[n].is_some_and(|step| step > UNEVEN) && falls[n].is_some_and(|fall| fall < UNEVEN_FALL));
    metrics.label_noise = label_noise::fraction(index, &at);
    metrics.ambiguity = label_noise::median_lead(textured.iter().map(|(_, saliency)| *saliency));
    metrics.order = FocusCurves::of(
        at.iter().copied().zip(textured.iter().map(|(_, saliency)| *saliency)),
        (index.width, index.height),
        slices,
    )
    .other_order();
    if slices >= 3 {
        let noise = floor / noise_floor::MARGIN;
        let near = AtEnd { textured: &textured, at: &at, end: 0, apart: apart(&falls) };
        let far = AtEnd { end: slices - 1, ..near };
        metrics.peak_at_first_fraction = Some(near.falling_fraction());
        metrics.peak_at_last_fraction = Some(far.falling_fraction());
        metrics.range_too_short_near = Some(near.is_too_short(decision_map, noise));
        metrics.range_too_short_far = Some(far.is_too_short(decision_map, noise));
    }
    DepthCoverage { metrics, contribution: contribution.into_iter().map(Some).collect(), steps }
}

/// The textured samples, seen from one end of the stack.
#[derive(Clone, Copy)]
struct AtEnd<'a> {
    /// Per sample: its label and the saliency of every slice.
    textured: &'a [(usize, &'a [f32])],
    /// Per sample: its position.
    at: &'a [(usize, usize)],
    /// Index of the end slice.
    end: usize,
    /// Distance between the slices from which the peak is estimated, slices.
    apart: usize,
}

impl AtEnd<'_> {
    /// Share of the samples that are labelled with the end slice and whose saliency falls over the next two slices.
    fn falling_fraction(&self) -> f64 {
        let falls = |label: usize, saliency: &[f32]| {
            let [a, b, c] = self.saliency(saliency, 1);
            label == self.end && a > b && b > c && c > 0.0
        };
        let falling = self.textured.iter().filter(|&&(label, saliency)| falls(label, saliency)).count();
        falling as f64 / self.textured.len() as f64
    }

    /// Whether the object extends beyond this end; see [`range::extends_beyond`].
    fn is_too_short(&self, decision_map: &DecisionMap<'_>, noise: f32) -> bool {
        let of_end = self.textured.iter().zip(self.at).filter(|((label, _), _)| *label == self.end);
        let curves = of_end.map(|((_, saliency), &at)| (at, self.saliency(saliency, self.apart)));
        let size = (decision_map.index.width, decision_map.index.height);
        range::extends_beyond(curves, self.textured.len(), size, noise, decision_map.refined)
    }

    /// Saliency in the end slice and in the two slices that are `apart` and twice `apart` steps from it.
    fn saliency(&self, of_slices: &[f32], apart: usize) -> [f32; 3] {
        [0, apart, 2 * apart].map(|steps| of_slices[if self.end == 0 { steps } else { self.end - steps }])
    }
}

/// Slices between the first and the last that contribute almost nothing.
fn redundant(contribution: &[f64]) -> Vec<u32> {
    let least = REDUNDANT.min(REDUNDANT_OF_MEAN / contribution.len().max(1) as f64);
    let inner = 1..contribution.len().saturating_sub(1);
    inner.filter(|&n| contribution[n] < least).map(|n| n as u32).collect()
}

/// Per pair of neighbours: the share to which the saliency of strong texture falls from the slice of its peak to the
/// other slice; geometric mean of both directions, each the median over the texture.
fn falls(textured: &[(usize, &[f32])], floor: f32, slices: usize) -> Vec<Option<f32>> {
    // per slice: the shares to which texture that peaks there has fallen in the slice before and in the slice after
    let mut before = vec![Vec::new(); slices];
    let mut after = vec![Vec::new(); slices];
    for (_, saliency) in textured {
        // the peak of the measurement counts, whichever slice the decision map has
        let sharpest = saliency.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
        let Some((sharpest_slice, &peak)) = sharpest else { continue };
        if peak < STRONG * floor {
            continue;
        }
        // 0 means not covered
        let fall = |n: usize| saliency.get(n).copied().filter(|&value| value > 0.0 && value <= peak);
        if let Some(value) = sharpest_slice.checked_sub(1).and_then(fall) {
            before[sharpest_slice].push(value / peak);
        }
        if let Some(value) = fall(sharpest_slice + 1) {
            after[sharpest_slice].push(value / peak);
        }
    }
    let fallen = |ratios: &mut Vec<f32>| match ratios.len() {
        ..LEAST_FOR_GAP => None,
        _ => statistics::quantile_interpolated(ratios, 0.5),
    };
    let mut pair = |n: usize| Some((fallen(&mut after[n])? * fallen(&mut before[n + 1])?).sqrt());
    (0..slices.saturating_sub(1)).map(&mut pair).collect()
}

/// By the model, focus moves by `w sqrt(1 / f - 1)` where saliency falls to the share `f`; in units of `w`.
fn distance(fall: f32) -> f32 {
    (1.0 / fall.max(0.01) - 1.0).max(0.0).sqrt()
}

/// The median step, in units of `w`; none if too few pairs are known.
fn usual_step(falls: &[Option<f32>]) -> Option<f32> {
    let mut known: Vec<f32> = falls.iter().flatten().map(|&fall| distance(fall)).collect();
    if known.len() < LEAST_FOR_USUAL {
        return None;
    }
    statistics::quantile_interpolated(&mut known, 0.5).filter(|&usual| usual > 0.0)
}

/// How far focus moves from slice to slice, in units of the median step.
fn steps(falls: &[Option<f32>]) -> Vec<Option<f32>> {
    let usual = usual_step(falls);
    falls.iter().map(|fall| Some(distance((*fall)?) / usual?)).collect()
}

/// How many steps slices are apart to be about [`APART`]; all three of them are in the nearer half of the stack.
fn apart(falls: &[Option<f32>]) -> usize {
    let most = (falls.len() / 4).max(1);
    usual_step(falls).map_or(1, |usual| (APART / usual).round() as usize).clamp(1, most)
}

#[cfg(test)]
mod tests;
