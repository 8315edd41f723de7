//! Whether the slices cover the object in depth, from the saliency of every slice on a sparse grid.

mod curve;
mod label_noise;
mod noise_floor;
mod range;
mod unfocused_area;

use super::{DecisionMap, focus_order::FocusCurves, sampling::Points, slice::SliceMeasurements, statistics};
use crate::{imaging::Plane, types::metrics::FocusMetrics};

/// Fewer textured samples than this say nothing about single slices.
const LEAST_TEXTURED: usize = 200;
/// A slice in the middle with a smaller share of the textured pixels is redundant...
const REDUNDANT: f64 = 0.002;
/// ... or, in long stacks, with a smaller part of the mean share.
const REDUNDANT_OF_MEAN: f64 = 0.1;
/// Halfway between two slices, texture that falls to less than this from either to the other is less than 0.7 as sharp
/// as in focus: it was missed.
const GAP: f32 = 0.37;
/// A step this many times the usual one is uneven ...
const UNEVEN: f32 = 1.7;
/// ... when texture falls to less than this over it.
const UNEVEN_FALL: f32 = 0.6;
/// Fewer pairs than this do not say what is usual.
const LEAST_FOR_USUAL: usize = 4;
/// Fewer pixels than this on a side say nothing about a gap.
const LEAST_FOR_GAP: usize = 30;
/// Only texture this much over the noise floor can show how deep the valley between two slices is.
const STRONG: f32 = 2.0;

/// The coverage in depth, and the contribution of every slice.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct DepthCoverage {
    pub(super) metrics: FocusMetrics,
    pub(super) contribution: Vec<Option<f64>>,
    /// Per pair of neighbours: about how many usual steps focus moves.
    pub(super) steps: Vec<Option<f32>>,
}

/// The samples that count: covered by some slice and, with a mask, of the object.
struct Samples {
    /// Saliency per sample and slice, sample by sample; 0 where a slice does not cover.
    saliency: Vec<f32>,
    /// The slice that fusion took.
    winner: Vec<usize>,
    /// Where they lie.
    at: Vec<(usize, usize)>,
    slices: usize,
}

impl Samples {
    fn of(seen: &[SliceMeasurements], points: &Points, index: &Plane<u16>) -> Self {
        let slices = seen.len();
        let mut samples = Self { saliency: Vec::new(), winner: Vec::new(), at: Vec::new(), slices };
        for (i, (x, y)) in points.positions().enumerate() {
            if x >= index.width || y >= index.height {
                continue;
            }
            let winner = usize::from(index.at(x, y));
            if winner >= slices {
                continue;
            }
            samples.winner.push(winner);
            samples.at.push((x, y));
            let value =
                |seen: &SliceMeasurements| seen.saliency.get(i).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
            samples.saliency.extend(seen.iter().map(value));
        }
        samples
    }

    /// Per sample: the slice that fusion took, and the saliency of every slice.
    fn each(&self) -> impl Iterator<Item = (usize, &[f32])> {
        self.winner.iter().copied().zip(self.saliency.chunks_exact(self.slices))
    }
}

/// Judges the coverage; `seen` in the order of the slices, `masked` when the points are of the object alone.
pub(super) fn coverage(
    seen: &[SliceMeasurements],
    points: &Points,
    decision_map: &DecisionMap<'_>,
    masked: bool,
) -> DepthCoverage {
    let index = decision_map.index;
    let slices = seen.len();
    let unknown = DepthCoverage { contribution: vec![None; slices], ..DepthCoverage::default() };
    let samples = Samples::of(seen, points, index);
    if samples.winner.is_empty() {
        return unknown;
    }
    let floor = noise_floor::measure(&samples.saliency);
    let is_textured: Vec<bool> =
        samples.each().map(|(_, saliency)| saliency.iter().any(|&value| value > floor)).collect();
    let textured: Vec<(usize, &[f32])> =
        samples.each().zip(&is_textured).filter(|(_, textured)| **textured).map(|(sample, _)| sample).collect();
    let share = textured.len() as f64 / samples.winner.len() as f64;
    let mut metrics = FocusMetrics {
        textured_fraction: Some(share),
        unfocused_fraction: masked.then_some(1.0 - share),
        unfocused_area: if masked { unfocused_area::largest(points, &samples.at, &is_textured) } else { None },
        ..FocusMetrics::default()
    };
    if textured.len() < LEAST_TEXTURED {
        return DepthCoverage { metrics, ..unknown };
    }
    let at: Vec<(usize, usize)> =
        samples.at.iter().zip(&is_textured).filter(|(_, textured)| **textured).map(|(&at, _)| at).collect();
    let mut counts = vec![0usize; slices];
    textured.iter().for_each(|&(winner, _)| counts[winner] += 1);
    let contribution: Vec<f64> = counts.iter().map(|&count| count as f64 / textured.len() as f64).collect();
    metrics.redundant_slices = redundant(&contribution);
    let falls = falls(&textured, floor, slices);
    let steps = steps(&falls);
    let pairs = |wanted: &dyn Fn(usize) -> bool| (0..falls.len()).filter(|&n| wanted(n)).map(|n| n as u32).collect();
    metrics.coverage_gaps = pairs(&|n| falls[n].is_some_and(|fall| fall < GAP));
    metrics.uneven_steps =
        pairs(&|n| steps[n].is_some_and(|step| step > UNEVEN) && falls[n].is_some_and(|fall| fall < UNEVEN_FALL));
    metrics.label_noise = label_noise::fraction(index, &at);
    metrics.ambiguity = label_noise::ambiguity(textured.iter().map(|(_, saliency)| *saliency));
    metrics.order = FocusCurves::of(
        at.iter().copied().zip(textured.iter().map(|(_, saliency)| *saliency)),
        (index.width, index.height),
        slices,
    )
    .other_order();
    if slices >= 3 {
        type Ends = fn(&[f32]) -> [f32; 3];
        let count = |past: &dyn Fn(usize, &[f32]) -> bool| {
            textured.iter().filter(|&&(winner, saliency)| past(winner, saliency)).count() as f64 / textured.len() as f64
        };
        let first: Ends = |s| [s[0], s[1], s[2]];
        let last: Ends = |s| [s[s.len() - 1], s[s.len() - 2], s[s.len() - 3]];
        let falling = |ends: Ends, end: usize| {
            count(&|winner, saliency| {
                let [a, b, c] = ends(saliency);
                winner == end && a > b && b > c && c > 0.0
            })
        };
        let beyond = |ends: Ends, end: usize| {
            let of_end = textured.iter().zip(&at).filter(|((winner, _), _)| *winner == end);
            let size = (index.width, index.height);
            let curves = of_end.map(|((_, saliency), &at)| (at, ends(saliency)));
            range::extends_beyond(curves, textured.len(), size, floor / noise_floor::MARGIN, decision_map.settled)
        };
        metrics.peak_at_first_fraction = Some(falling(first, 0));
        metrics.peak_at_last_fraction = Some(falling(last, slices - 1));
        metrics.range_too_short_near = Some(beyond(first, 0));
        metrics.range_too_short_far = Some(beyond(last, slices - 1));
    }
    DepthCoverage { metrics, contribution: contribution.into_iter().map(Some).collect(), steps }
}

/// Slices between the first and the last that hardly any textured pixel needs.
fn redundant(contribution: &[f64]) -> Vec<u32> {
    let least = REDUNDANT.min(REDUNDANT_OF_MEAN / contribution.len().max(1) as f64);
    let inner = 1..contribution.len().saturating_sub(1);
    inner.filter(|&n| contribution[n] < least).map(|n| n as u32).collect()
}

/// Per pair of neighbours: to what share strong texture falls from the slice where it peaks to the other, seen from both.
fn falls(textured: &[(usize, &[f32])], floor: f32, slices: usize) -> Vec<Option<f32>> {
    // per slice: how far what peaks there has fallen in the slice before and in the slice after it
    let mut before = vec![Vec::new(); slices];
    let mut after = vec![Vec::new(); slices];
    for (_, saliency) in textured {
        // how deep the valley is shows in what was measured, whichever slice fusion took
        let sharpest = saliency.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
        let Some((winner, &peak)) = sharpest else { continue };
        if peak < STRONG * floor {
            continue;
        }
        // 0 stands for "not covered", which says nothing of depth
        let fall = |n: usize| saliency.get(n).copied().filter(|&value| value > 0.0 && value <= peak);
        if let Some(value) = winner.checked_sub(1).and_then(fall) {
            before[winner].push(value / peak);
        }
        if let Some(value) = fall(winner + 1) {
            after[winner].push(value / peak);
        }
    }
    let fallen = |ratios: &mut Vec<f32>| match ratios.len() {
        ..LEAST_FOR_GAP => None,
        _ => statistics::median(ratios),
    };
    let mut pair = |n: usize| Some((fallen(&mut after[n])? * fallen(&mut before[n + 1])?).sqrt());
    (0..slices.saturating_sub(1)).map(&mut pair).collect()
}

/// How far focus moves from slice to slice, in usual steps: saliency falls with defocus about as 1 / (1 + (z / w)^2).
fn steps(falls: &[Option<f32>]) -> Vec<Option<f32>> {
    let distance = |fall: f32| (1.0 / fall.max(0.01) - 1.0).max(0.0).sqrt();
    let mut known: Vec<f32> = falls.iter().flatten().map(|&fall| distance(fall)).collect();
    if known.len() < LEAST_FOR_USUAL {
        return vec![None; falls.len()];
    }
    let usual = statistics::median(&mut known).filter(|&usual| usual > 0.0);
    falls.iter().map(|fall| Some(distance((*fall)?) / usual?)).collect()
}

#[cfg(test)]
mod tests;
