//! The decision map: per pixel, the slice in which it is sharp.
//!
//! In: the sharpest slice per pixel (argmax of the focus energy), its energy, and the coarse focus. Out: a
//! [`DecisionMap`].
//!
//! The argmax is wrong beside strong detail: a strong edge, defocused, can have more focus energy than the smooth
//! surface over which it spreads has in any slice. That blur can be predicted. For each scale of the coarse focus, from
//! narrow to wide, let `a` be the slice that is sharpest around a pixel, `b` the pixel's own slice, `r` the blur radius
//! between them, `D` the disc of that radius, `E` the focus energy, and `E_around` that of `a` in the window of the
//! scale. A pixel takes `a` instead of `b`
//!
//! | pixel | when |
//! |---|---|
//! | without texture | `a` and `b` are separable, or nothing around the pixel has texture |
//! | textured, but `E(I_b) <= 0.045 E_around` at the narrow scale | both are separable |
//! | textured | both are separable, `E(I_b) <= max(8 / r^2, 1 / 12) E_around`, and `E(I_b - D * I_a) < 0.2 E(I_b)` |
//!
//! The second row: beside strong detail, such as a bright outline on black ground, the rim of its disc has weak energy
//! at every distance, in one slice or another. That slice would be taken for the slice of another part, and blur would
//! be removed that is not there. No prediction is exact enough to tell, so such a pixel counts as one without texture.
//!
//! The second condition of the last row saves time: blur leaves little of the energy of detail, so a pixel with more
//! than that has detail of its own, and no prediction is made for it.
//!
//! The argmax is also wrong where a thin or smooth near part lies before strong texture: [`near_detail`] finds such
//! parts. Finally, a median filter removes outliers.

mod blur_prediction;
mod given;
mod map;
mod median_filter;
mod near_detail;
mod refinement;

use std::sync::Arc;

use rayon::prelude::*;

use super::{defocus_model::DefocusModel, warped_slices::WarpedSlices};
use crate::{
    fusion::{lock::Spare, run::Run},
    imaging::{Plane, Rect, Sample, filter::focus::Rows},
    types::Interrupted,
};
pub(super) use given::given;
pub(crate) use map::DecisionMap;
use median_filter::{MEDIAN_REACH, median_filter};
use near_detail::NearDetail;
pub(super) use refinement::{MeasuredFocus, TEXTURED};
use refinement::{Refinement, Tile};

/// Side of the tiles, px. Tiles consist of whole cells of the coarse focus and give two planes, so the tile driver of
/// the second pass, which cuts the canvas into equal parts and gives samples, does not serve here.
const TILE: usize = 256;

/// Refines the argmax of the focus energy; `textured` is where that energy is more than noise. Blur is predicted within
/// `margin` px of every shown pixel; what is farther away is refined as if nothing could be predicted.
pub(super) fn refine<S: Sample, const C: usize>(
    (run, margin): (&Run<'_>, usize),
    slices: &WarpedSlices<'_, S, C>,
    focus: MeasuredFocus<'_>,
    textured: Plane<bool>,
    model: &DefocusModel,
) -> Result<DecisionMap, Interrupted> {
    let (width, height) = slices.size();
    let tiles: Vec<Rect> = (0..height)
        .step_by(TILE)
        .flat_map(|y| {
            (0..width).step_by(TILE).map(move |x| Rect {
                x,
                y,
                width: TILE.min(width - x),
                height: TILE.min(height - y),
            })
        })
        .collect();
    let (refinement, spare) = (Refinement { slices, focus, model }, Spare::new());
    let tiles: Vec<(Tile, Vec<NearDetail>)> = tiles
        .into_par_iter()
        .with_max_len(1)
        .map(|rect| {
            let matters = run.part_to_fuse(rect, margin + MEDIAN_REACH + near_detail::RIM).is_some();
            let mut tile = Tile { rect, slice: focus.sharpest.crop(rect).data, textured: textured.crop(rect).data };
            spare.with(Rows::default, |rows| {
                refinement.refine_by_surroundings(&mut tile, matters, rows)?;
                let near_detail = if matters { refinement.near_detail(&tile, rows)? } else { Vec::new() };
                Ok((tile, near_detail))
            })
        })
        .collect::<Result<_, Interrupted>>()?;
    let (mut slice, mut textured) = (Plane::filled(width, height, 0), textured);
    let band = (width * TILE).max(1);
    let bands = slice.data.par_chunks_mut(band).zip(textured.data.par_chunks_mut(band));
    bands.zip(tiles.par_chunks(width.div_ceil(TILE).max(1))).for_each(|((slices, textured), tiles)| {
        for (Tile { rect, slice, textured: has_texture }, _) in tiles {
            for y in 0..rect.height {
                let (from, to) = (y * rect.width, y * width + rect.x);
                slices[to..to + rect.width].copy_from_slice(&slice[from..from + rect.width]);
                textured[to..to + rect.width].copy_from_slice(&has_texture[from..from + rect.width]);
            }
        }
    });
    let found = tiles.into_iter().flat_map(|(_, near_detail)| near_detail).collect();
    near_detail::apply((&mut slice, &mut textured), found, model);
    Ok(DecisionMap { slice: Arc::new(median_filter(slices, &slice)), textured })
}
