//! Halo-corrected fusion: the second pass of [`Method::HaloCorrected`](crate::types::fusion_options::Method).
//!
//! Every mosaic of slices has a halo where a near part overlaps a far one: in each slice that shows the far part sharp,
//! the blur of the near part lies over it (the *defocus spread effect*: Xu et al., IEEE TCI 2020; Ma et al., IEEE TIP
//! 2020). A calibrated stack determines how large that blur is, and the slice of the near part shows the same place
//! uncovered.
//!
//! In: the warped slices, the sharpest slice per pixel, its focus energy, and the coarse focus. Out: the fused image
//! and the decision map. The steps, in order of execution:
//!
//! 1. [`warped_slices`] reads rectangles of the slices back from the scratch file.
//! 2. [`defocus_measurement`] measures the blur radius per step of focus, and finds which end of the stack is near.
//! 3. [`decision_map`] decides from which slice each pixel is taken.
//! 4. [`mosaic`] composes the pixels of a tile by that map, averaging slices that show the same.
//! 5. [`correction`] removes the blur of near parts from far pixels of the tile.
//! 6. [`confidence`] blends the tile with the pyramid image, which has halos but no seams, where that is safer.
//!
//! Steps 1 to 3 and the pyramid image are made once per stack, steps 4 to 6 tile by tile.

mod confidence;
mod correction;
mod decision;
mod decision_map;
mod defocus_measurement;
mod defocus_model;
mod depth_order;
mod mosaic;
mod pixel_groups;
mod rounding;
mod warped_slices;

use super::{
    align::{Aligned, MeasuredEnergy},
    pyramid,
    run::Run,
    shown,
    tiles::{Blended, in_tiles},
};
use crate::{
    imaging::{
        Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
        simd::{self, Avx2},
    },
    types::{Error, ErrorKind, Interrupted},
};
use confidence::ImagePair;
pub use decision::Decision;
use decision_map::{DecisionMap, MeasuredFocus, TEXTURED};
use defocus_model::DefocusModel;
use rounding::{out_of_range, rounded};
use warped_slices::WarpedSlices;

/// Fuses a stack; returns the image, and what decided it. `aligned.index` becomes the slice that each pixel is taken
/// from.
///
/// Without a measured blur, only textureless pixels and outliers of the decision map are refined, and nothing can be
/// corrected: then the pyramid image is returned.
pub(super) fn fuse<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &mut Aligned,
) -> Result<(Blended<S>, Decision), Interrupted> {
    run.control.check()?;
    let no_energy = || Error::new(ErrorKind::Internal, "the first pass has not measured the focus energy");
    let MeasuredEnergy { largest: energy, coarse, cells } = aligned.energy.take().ok_or_else(no_energy)?;
    let plan = run.plan;
    let slices = WarpedSlices::<S, C>::new(aligned, run.control);
    let coarse = coarse.finish(plan.reference);
    let textured = energy.par_map(|energy| energy.value() > TEXTURED * coarse.noise);
    let model =
        defocus_measurement::measure(&slices, &aligned.index, &textured, plan.rail_mm().as_deref(), plan.near_first)?;
    let what = (run, shown::MARGIN + reach() + correction::REACH);
    let focus = MeasuredFocus { sharpest: &aligned.index, energy: &energy, coarse: &coarse, cells: &cells };
    let mut map = decision_map::refine(what, &slices, focus, textured, &model)?;
    if let Some(given) = run.decision_map {
        map = decision_map::given(&slices, map, given, coarse.noise)?;
    }
    let relevance = cells.relevance(coarse.noise, &aligned.coverages, run.control)?;
    // the pictures that follow take memory: free what only the decision map needed
    drop((energy, coarse));
    aligned.index = map.slice.clone();
    let slices = WarpedSlices::<S, C>::new(aligned, run.control);
    let pyramid = pyramid::blend::<S, C>(run, aligned, Some(&relevance), shown::MARGIN + reach())?;
    if !model.is_known() {
        return Ok((pyramid, Decision { map, model }));
    }
    let fusion = Fusion { slices: &slices, map: &map, model: &model, pyramid: &pyramid.pixels };
    let what = (run, &*aligned, shown::MARGIN);
    let tile = |rows: &mut Rows, rect: Rect, out: &mut Vec<S>| fusion.tile(rect, out, rows);
    let mut blended = in_tiles::<S, C, _>(what, "correcting halos", Rows::default, tile)?;
    blended.clamped = blended.clamped.max(pyramid.clamped);
    blended.contradicts_profile = model.contradicts_profile;
    Ok((blended, Decision { map, model }))
}

/// How far around a tile its pixels depend on the mosaic and on the pyramid image, px.
fn reach() -> usize {
    confidence::REACH.max(FocusEnergy::for_edges().reach())
}

/// What all tiles share.
struct Fusion<'a, S, const C: usize> {
    slices: &'a WarpedSlices<'a, S, C>,
    map: &'a DecisionMap,
    model: &'a DefocusModel,
    /// Interleaved samples of the pyramid image.
    pyramid: &'a [S],
}

impl<S: Sample, const C: usize> Fusion<'_, S, C> {
    /// Fuses the tile `rect` into `out`; returns the number of pixels of the mosaic with a sample more than one grey
    /// level outside the range.
    fn tile(&self, rect: Rect, out: &mut Vec<S>, rows: &mut Rows) -> Result<usize, Interrupted> {
        let Self { slices, map, model, pyramid } = *self;
        let (width, height) = slices.size();
        let window = rect.grown(reach(), width, height);
        let mut values = mosaic::mosaic(slices, map, model, window)?;
        let before = values.clone();
        correction::correct(slices, map, model, window, &mut values)?;

        let change = mean_change::<C>(&before, &values);
        let (corrected, uncorrected) = (rounded::<S>(&values), rounded::<S>(&before));
        let mut pyramid_part = Vec::with_capacity(corrected.len());
        for y in window.y..window.y + window.height {
            pyramid_part.extend_from_slice(&pyramid[(y * width + window.x) * C..][..window.width * C]);
        }
        let pair = ImagePair {
            window,
            corrected: &corrected,
            values: &values,
            uncorrected: &uncorrected,
            pyramid: &pyramid_part,
            change: &change,
        };
        pair.blend::<C>(rect, rows, out);
        Ok(out_of_range::<S, C>(&values, window, rect))
    }
}

/// Per pixel: the absolute change, averaged over channels.
fn mean_change<const C: usize>(before: &[f32], after: &[f32]) -> Vec<f32> {
    let mut change = vec![0.0; after.len() / C];
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || {
            let pixels = before.as_chunks::<C>().0.iter().zip(after.as_chunks::<C>().0);
            for (change, (before, after)) in change.iter_mut().zip(pixels) {
                *change = (0..C).map(|c| (after[c] - before[c]).abs()).sum::<f32>() / C as f32;
            }
        },
    );
    change
}
