//! A decision map that is given, for benches: the true one tells how much a better decision map can gain.

use std::sync::Arc;

use rayon::prelude::*;

use super::{super::warped_slices::WarpedSlices, map::DecisionMap, refinement::TEXTURED};
use crate::{
    fusion::plan::UNCOVERED,
    imaging::{
        Plane, Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
    },
    types::Interrupted,
};

/// The decision map with the slices of `given`, and those of `found` where the given slice does not cover the pixel. A
/// pixel of another slice than before is textured if its focus energy in that slice is more than [`TEXTURED`] times
/// that of `noise`.
pub(in super::super) fn given<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    found: DecisionMap,
    given: &Plane<u16>,
    noise: f32,
) -> Result<DecisionMap, Interrupted> {
    let (width, height) = slices.size();
    let covers = |slice: u16, x: usize, y: usize| {
        usize::from(slice) < slices.count() && slices.coverage(slice.into()).span(y).contains(&x)
    };
    let slice = Plane::from_fn(width, height, |x, y| match (found.slice.at(x, y), given.at(x, y)) {
        (UNCOVERED, _) => UNCOVERED,
        (_, given) if covers(given, x, y) => given,
        (found, _) => found,
    });
    let mut textured = found.textured;
    let measure = FocusEnergy::for_decision_map();
    for of in 0..slices.count() {
        let luma = slices.luma(of, Rect::whole(width, height))?;
        let energy = measure.plane(&luma, &mut Rows::default());
        let slices = slice.data.par_iter().zip(&found.slice.data);
        textured.data.par_iter_mut().zip(slices).zip(&energy.data).for_each(|((textured, (slice, found)), energy)| {
            if slice != found && usize::from(*slice) == of {
                *textured = *energy > TEXTURED * noise;
            }
        });
    }
    Ok(DecisionMap { slice: Arc::new(slice), textured })
}
