//! Whether the slices cover the object in depth, from the saliency of every slice on a sparse grid.

mod curve;
mod noise;

use super::{sampling::Points, slice::Seen, statistics};
use crate::{imaging::Plane, model::metrics::FocusMetrics};

/// Fewer textured samples than this say nothing about single slices.
const LEAST_TEXTURED: usize = 200;
/// A slice in the middle with a smaller share of the textured pixels is redundant...
const REDUNDANT: f64 = 0.002;
/// ... or, in long stacks, with a smaller part of the mean share.
const REDUNDANT_OF_MEAN: f64 = 0.1;
/// More than this share of the textured pixels in focus beyond an end: the range is too short there.
const BEYOND: f64 = 0.01;
/// Texture that falls to less than this, from its peak to the next slice, both ways, was missed between.
const GAP: f32 = 0.3;
/// Fewer pixels than this on a side say nothing about a gap.
const LEAST_FOR_GAP: usize = 30;
/// Only texture this much over the noise floor can show how deep the valley between two slices is.
const STRONG: f32 = 2.0;

/// The coverage in depth, and the contribution of every slice.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Coverage {
    pub(super) metrics: FocusMetrics,
    pub(super) contribution: Vec<Option<f64>>,
}

/// The samples that count: covered by some slice and, with a mask, of the object.
struct Samples {
    /// Saliency per sample and slice, sample by sample; 0 where a slice does not cover.
    saliency: Vec<f32>,
    /// The slice that fusion took.
    winner: Vec<usize>,
    slices: usize,
}

impl Samples {
    fn of(seen: &[Seen], points: &Points, index: &Plane<u16>) -> Self {
        let slices = seen.len();
        let mut samples = Self { saliency: Vec::new(), winner: Vec::new(), slices };
        for (i, (x, y)) in points.positions().enumerate() {
            if x >= index.width || y >= index.height {
                continue;
            }
            let winner = usize::from(index.at(x, y));
            if winner >= slices {
                continue;
            }
            samples.winner.push(winner);
            let value = |seen: &Seen| seen.saliency.get(i).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
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
pub(super) fn coverage(seen: &[Seen], points: &Points, index: &Plane<u16>, masked: bool) -> Coverage {
    let slices = seen.len();
    let unknown = Coverage { contribution: vec![None; slices], ..Coverage::default() };
    let samples = Samples::of(seen, points, index);
    if samples.winner.is_empty() {
        return unknown;
    }
    let floor = noise::floor(&samples.saliency);
    let textured: Vec<(usize, &[f32])> =
        samples.each().filter(|(_, saliency)| saliency.iter().any(|&value| value > floor)).collect();
    let share = textured.len() as f64 / samples.winner.len() as f64;
    let mut metrics = FocusMetrics {
        textured_fraction: Some(share),
        unfocused_fraction: masked.then_some(1.0 - share),
        ..FocusMetrics::default()
    };
    if textured.len() < LEAST_TEXTURED {
        return Coverage { metrics, ..unknown };
    }
    let mut counts = vec![0usize; slices];
    textured.iter().for_each(|&(winner, _)| counts[winner] += 1);
    let contribution: Vec<f64> = counts.iter().map(|&count| count as f64 / textured.len() as f64).collect();
    metrics.redundant_slices = redundant(&contribution);
    metrics.coverage_gaps = gaps(&textured, floor, slices);
    if slices >= 3 {
        let beyond = |ends: fn(&[f32]) -> [f32; 3], end: usize| {
            let past = |&&(winner, saliency): &&(usize, &[f32])| {
                winner == end && curve::peaks_before(ends(saliency), floor / noise::MARGIN)
            };
            textured.iter().filter(past).count() as f64 > BEYOND * textured.len() as f64
        };
        metrics.range_too_short_near = Some(beyond(|s| [s[0], s[1], s[2]], 0));
        metrics.range_too_short_far = Some(beyond(|s| [s[s.len() - 1], s[s.len() - 2], s[s.len() - 3]], slices - 1));
    }
    Coverage { metrics, contribution: contribution.into_iter().map(Some).collect() }
}

/// Slices between the first and the last that hardly any textured pixel needs.
fn redundant(contribution: &[f64]) -> Vec<u32> {
    let least = REDUNDANT.min(REDUNDANT_OF_MEAN / contribution.len().max(1) as f64);
    let inner = 1..contribution.len().saturating_sub(1);
    inner.filter(|&n| contribution[n] < least).map(|n| n as u32).collect()
}

/// Pairs of neighbours between which strong texture is lost: seen from either, it falls too far in the other.
fn gaps(textured: &[(usize, &[f32])], floor: f32, slices: usize) -> Vec<u32> {
    // per slice: how far what peaks there has fallen in the slice before and in the slice after it
    let mut before = vec![Vec::new(); slices];
    let mut after = vec![Vec::new(); slices];
    for &(winner, saliency) in textured {
        let peak = saliency[winner];
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
    let mut gaps = Vec::new();
    for n in 0..slices.saturating_sub(1) {
        if let (Some(down), Some(up)) = (fallen(&mut after[n]), fallen(&mut before[n + 1]))
            && (down * up).sqrt() < GAP
        {
            gaps.push(n as u32);
        }
    }
    gaps
}

#[cfg(test)]
mod tests;
