//! Where fusion shows its work to the metrics: nothing else in this floor knows them.

use super::{Plan, Watch, align::Aligned};
use crate::{
    imaging::{Plane, Rect, Sample, grey},
    model::{Control, Stop},
    quality::{
        self, StackQuality,
        alignment::Alignment,
        slice::{Observer, Seen},
        tile::Sums,
    },
};

/// Who looks at each warped slice, when metrics are wanted.
pub(super) fn observer<'a>(plan: &Plan, watch: &Watch<'a>) -> Option<Observer<'a>> {
    let observer = || Observer::new(plan.width, plan.height, plan.homographies.len(), plan.reference);
    watch.metrics.then(|| observer().within(watch.object))
}

/// Residual shifts between warped neighbours.
pub(super) fn alignment<S: Sample>(
    aligned: &Aligned,
    plan: &Plan,
    watch: &Watch<'_>,
    control: &dyn Control,
) -> Result<Alignment, Stop> {
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
    let found = quality::alignment::measure(aligned.coverages.len(), &read, plan.width, plan.height, watch.object);
    control.check()?;
    Ok(found)
}

/// Luma 0..255 of the interleaved pixels of `rect`.
pub(super) fn luma<S: Sample>(samples: &[S], rect: Rect) -> Plane<f32> {
    let channels = samples.len() / (rect.width * rect.height).max(1);
    let mut plane = Plane::filled(rect.width, rect.height, 0.0);
    grey::luma_row(samples, channels.max(1), &mut plane.data);
    plane
}

/// `rect` of a mask of the whole canvas.
pub(super) fn part(mask: &Plane<u8>, rect: Rect) -> Plane<u8> {
    Plane::from_fn(rect.width, rect.height, |x, y| mask.at(rect.x + x, rect.y + y))
}

/// All metrics together, when they are wanted.
pub(super) fn finish(
    seen: Vec<Seen>,
    sums: Sums,
    alignment: Alignment,
    index: &Plane<u16>,
    watch: &Watch<'_>,
) -> Option<StackQuality> {
    watch.metrics.then(|| quality::finish(seen, sums, alignment, index, watch.object))
}
