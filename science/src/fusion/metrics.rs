//! Measures the metrics of a fusion, if they were requested: alignment, scores and the final report.
//!
//! The first pass ([`align`](super::align)) passes each warped slice to the [`SliceMeter`]; everything else is here.

use rayon::prelude::*;

use super::{align::Aligned, run::Run};
use crate::{
    imaging::{Plane, Rect, Sample, grey},
    quality::{
        self, StackQuality,
        alignment::Alignment,
        sampling::Blocks,
        score::{ScoreSums, Scorer},
        slice::{SliceMeasurements, SliceMeter},
    },
    types::{Homography, Interrupted},
};

/// The meter for the warped slices, if metrics were requested.
pub(super) fn slice_meter<'a>(run: &Run<'a>) -> Option<SliceMeter<'a>> {
    let (plan, request) = (run.plan, run.request);
    let slices = plan.slices.len();
    request.metrics.then(|| SliceMeter::new(plan.width, plan.height, slices, plan.reference, request.object))
}

/// Measures the residual shifts between neighbouring warped slices.
pub(super) fn alignment<S: Sample>(run: &Run<'_>, aligned: &Aligned) -> Result<Alignment, Interrupted> {
    let (plan, request, control) = (run.plan, run.request, run.control);
    if !request.metrics {
        return Ok(Alignment::default());
    }
    control.check()?;
    let read = |slice: usize, rect: Rect| -> Option<(Plane<f32>, Plane<u8>)> {
        // after a cancel the result is discarded: reading nothing ends the measurement soon
        control.check().ok()?;
        let inside = rect.x + rect.width <= plan.width && rect.y + rect.height <= plan.height;
        let coverage = aligned.coverages.get(slice).filter(|_| inside)?;
        let (mut samples, mut bytes) = (Vec::new(), Vec::new());
        aligned.scratch.read::<S>(slice, rect, &mut samples, &mut bytes).ok()?;
        Some((luma(&samples, rect), coverage.mask(rect)))
    };
    let (slices, object) = (aligned.coverages.len(), request.object);
    let mut alignment = quality::alignment::measure(slices, &read, plan.width, plan.height, object);
    alignment.detect_foreign(&aligned.measurements, &read, (plan.width, plan.height), object);
    control.check()?;
    let homographies: Vec<Homography> = plan.slices.iter().map(|slice| slice.homography).collect();
    alignment.detect_reversal(&homographies, (plan.width, plan.height));
    alignment.metrics.common_fraction = common_fraction(aligned);
    Ok(alignment)
}

/// The luma, 0..255, of the interleaved samples of `rect`.
fn luma<S: Sample>(samples: &[S], rect: Rect) -> Plane<f32> {
    let channels = samples.len() / (rect.width * rect.height).max(1);
    let mut plane = Plane::filled(rect.width, rect.height, 0.0);
    grey::luma_row(samples, channels.max(1), &mut plane.data);
    plane
}

/// Scores the fused image against the slices in the sampled blocks of the canvas.
pub(super) fn score<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
    blocks: &Blocks,
    fused: &[S],
) -> Result<ScoreSums, Interrupted> {
    let of_block = |rect: &Rect| -> Result<ScoreSums, Interrupted> {
        let rect = *rect;
        let rows = (rect.y..rect.y + rect.height).map(|y| (y * run.plan.width + rect.x) * C);
        let mut luma = Plane::filled(rect.width, rect.height, 0.0);
        for (y, start) in rows.enumerate() {
            grey::luma_row(&fused[start..start + rect.width * C], C, luma.row_mut(y));
        }
        let object = run.request.object.map(|object| object.crop(rect));
        let mut scorer = Scorer::new(&luma, object.as_ref());
        let (mut samples, mut bytes) = (Vec::<S>::new(), Vec::new());
        let mut source = Plane::filled(rect.width, rect.height, 0.0);
        for (slice, coverage) in aligned.coverages.iter().enumerate() {
            if coverage.misses(rect) {
                continue;
            }
            run.control.check()?;
            aligned.scratch.read(slice, rect, &mut samples, &mut bytes)?;
            grey::luma_row(&samples, C, &mut source.data);
            let valid = (!coverage.contains(rect)).then(|| coverage.mask(rect));
            scorer.slice(&source, valid.as_ref());
        }
        Ok(scorer.sums())
    };
    let scores = blocks.rects.par_iter().with_max_len(1).map(of_block).collect::<Result<Vec<_>, Interrupted>>()?;
    // in the order of the blocks, whichever thread scored them
    let mut sums = ScoreSums::default();
    scores.iter().for_each(|score| sums.merge(score));
    Ok(sums)
}

/// Combines all metrics, if they were requested.
pub(super) fn finish(
    run: &Run<'_>,
    meter: Option<&SliceMeter<'_>>,
    measurements: Vec<SliceMeasurements>,
    scores: &ScoreSums,
    alignment: Alignment,
    index: &Plane<u16>,
) -> Option<StackQuality> {
    let map = quality::DecisionMap { index, refined: run.plan.method.refines_the_index() };
    meter.map(|meter| quality::finish(meter, measurements, scores, alignment, &map, run.slices.names()))
}

/// The fraction of the canvas that every slice covers.
fn common_fraction(aligned: &Aligned) -> Option<f64> {
    let (first, rest) = aligned.coverages.split_first()?;
    let common = rest.iter().fold(first.clone(), |common, coverage| common.intersection(coverage));
    Some(common.pixels() as f64 / (common.width() * common.height()).max(1) as f64)
}

#[cfg(test)]
mod diagnostics;
#[cfg(test)]
mod sampling_error;
#[cfg(test)]
mod usual_scores;
