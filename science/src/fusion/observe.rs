//! Where fusion shows its work to the metrics: nothing else in this floor knows them.

use rayon::prelude::*;

use super::{Plan, Run, Watch, align::Aligned};
use crate::{
    imaging::{Plane, Rect, Sample, grey},
    quality::{
        self, StackQuality,
        alignment::Alignment,
        sampling::Blocks,
        score::{ScoreSums, Scorer},
        slice::{SliceMeasurements, SliceMeter},
    },
    types::{Control, Interrupted, fusion_options::Method},
};

/// Who looks at each warped slice, when metrics are wanted.
pub(super) fn observer<'a>(plan: &Plan, watch: &Watch<'a>) -> Option<SliceMeter<'a>> {
    let slices = plan.homographies.len();
    watch.metrics.then(|| SliceMeter::new(plan.width, plan.height, slices, plan.reference, watch.object))
}

/// Residual shifts between warped neighbours.
pub(super) fn alignment<S: Sample>(
    aligned: &Aligned,
    plan: &Plan,
    watch: &Watch<'_>,
    control: &dyn Control,
) -> Result<Alignment, Interrupted> {
    if !watch.metrics {
        return Ok(Alignment::default());
    }
    control.check()?;
    let read = |slice: usize, rect: Rect| -> Option<(Plane<f32>, Plane<u8>)> {
        // once cancelled, what is measured is thrown away: let it end soon
        control.check().ok()?;
        let inside = rect.x + rect.width <= plan.width && rect.y + rect.height <= plan.height;
        let coverage = aligned.coverages.get(slice).filter(|_| inside)?;
        let (mut samples, mut bytes) = (Vec::new(), Vec::new());
        aligned.scratch.read::<S>(slice, rect, &mut samples, &mut bytes).ok()?;
        Some((luma(&samples, rect), coverage.mask(rect)))
    };
    let mut found = quality::alignment::measure(aligned.coverages.len(), &read, plan.width, plan.height, watch.object);
    control.check()?;
    found.detect_reversal(&plan.homographies, (plan.width, plan.height));
    found.metrics.common_fraction = common_fraction(aligned);
    Ok(found)
}

/// Luma 0..255 of the interleaved pixels of `rect`.
fn luma<S: Sample>(samples: &[S], rect: Rect) -> Plane<f32> {
    let channels = samples.len() / (rect.width * rect.height).max(1);
    let mut plane = Plane::filled(rect.width, rect.height, 0.0);
    grey::luma_row(samples, channels.max(1), &mut plane.data);
    plane
}

/// Score of the fused picture against the slices, in some blocks of the canvas.
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
        let object = run.watch.object.map(|object| object.crop(rect));
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
    // in the order of the blocks, whoever scored them
    let mut sums = ScoreSums::default();
    scores.iter().for_each(|score| sums.merge(score));
    Ok(sums)
}

/// All metrics together, when they are wanted.
pub(super) fn finish(
    run: &Run<'_>,
    observer: Option<&SliceMeter<'_>>,
    seen: Vec<SliceMeasurements>,
    sums: &ScoreSums,
    alignment: Alignment,
    index: &Plane<u16>,
) -> Option<StackQuality> {
    let names = (0..run.slices.count()).map(|slice| run.slices.name(slice).to_owned()).collect();
    let choice = quality::DecisionMap { index, settled: run.plan.method == Method::HaloCorrected };
    observer.map(|observer| quality::finish(observer, seen, sums, alignment, &choice, names))
}

/// Share of the canvas that every slice covers.
fn common_fraction(aligned: &Aligned) -> Option<f64> {
    let (first, rest) = aligned.coverages.split_first()?;
    let common = rest.iter().fold(first.clone(), |common, coverage| common.intersection(coverage));
    Some(common.pixels() as f64 / (common.width() * common.height()).max(1) as f64)
}

#[cfg(test)]
mod diagnostics;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod usual;
