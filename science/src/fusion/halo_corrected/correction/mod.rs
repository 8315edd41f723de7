//! Removes defocus spread from a tile: the blur of near parts that lies over what is behind them.
//!
//! In: the mosaic of a tile, the decision map and the defocus model. Out: the same tile, corrected.
//!
//! Beside the outline of a near part, sharp in slice `a`, a far part, sharp in slice `b`, is covered by the near part's
//! blur in `b` and in every slice like it. But slice `a` shows the far part too, uncovered, only blurred by the disc
//! `D` of known radius. So the far part is `I_a + g (I_b - D * I_b)`: coarse structure from the slice of the near part,
//! detail from its own. The cover weakens that detail, and the gain `g` restores it. What remains of the cover is the
//! detail of a blur, which is little. No outline is needed: where the formula is applied to the near part by
//! mistake, it changes little, because the near part's blur has little detail either.
//!
//! | pixel | mosaic `I` becomes |
//! |---|---|
//! | covered by near parts, textured (`t` and `g` from [`defocus_spread`]) | `I + t (I_a + g (I - D * I_b) - I)` |
//! | the same, without texture | `I + t (I_a - I)` |
//! | near, but in reach of the far part ([`fattening`]) | `I + m (I_b - D * I_b)`, `m` from the [`boundary_matte`] |
//!
//! Each result is clamped to 8 grey levels around the range that `I_a`, `I_b` and `I` span at the pixel. Pixels that
//! `I_a` or `I_b` does not cover stay as they are.

mod boundary_matte;
mod corrections;
mod defocus_spread;
mod fattening;
mod sliding_maximum;

use super::{
    decision_map::DecisionMap,
    defocus_model::{DefocusModel, MAX_RADIUS},
    pixel_groups::bounding_box,
    warped_slices::WarpedSlices,
};
use crate::{
    fusion::plan::UNCOVERED,
    imaging::{Rect, Sample, filter::disc::Disc},
    types::Interrupted,
};
use boundary_matte::BoundaryMatte;
use corrections::{Correction, Corrections, Kind};

/// How far a corrected pixel may lie beyond what both slices show there, grey levels of 255. A highlight that clips or
/// moves is no blur of the other slice and must not be removed as if it were.
const MAX_BEYOND: f32 = 8.0;

/// How far around a tile the decision map matters, px: what a disc of the largest radius reaches in
/// [`defocus_spread`], where it is blurred in squares of two cells of 4 px.
pub(super) const REACH: usize = MAX_RADIUS as usize + 16;

/// Pixels of a row that are compared at once.
const RUN: usize = 16;

/// Corrects the tile `rect`: its pixels are interleaved in `out`, in the scale of the samples.
pub(super) fn correct<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &DecisionMap,
    model: &DefocusModel,
    rect: Rect,
    out: &mut [f32],
) -> Result<(), Interrupted> {
    if !model.has_spread() {
        return Ok(());
    }
    let (width, height) = slices.size();
    let around = present(map, slices.count(), rect.grown(REACH, width, height));
    let inside = present(map, slices.count(), rect);
    let spreads = |near: u16, far: u16| model.spreads_over(usize::from(near), usize::from(far));
    let pairs = around.iter().flat_map(|&near| inside.iter().map(move |&far| (near, far)));
    let covering: Vec<(u16, u16)> = pairs.filter(|&(near, far)| spreads(near, far)).collect();
    let may_be_fattened = inside.iter().any(|&near| around.iter().any(|&far| spreads(near, far)));
    if covering.is_empty() && !may_be_fattened {
        return Ok(());
    }
    let mut corrections = Corrections::new(rect.width);
    let fattened = fattening::find(map, model, slices.count(), rect, &mut corrections);
    defocus_spread::find(map, model, slices.control(), rect, &covering, &fattened, &mut corrections)?;
    for ((near, far, ..), corrections) in corrections.finish() {
        apply(slices, map, model, rect, (near.into(), far.into()), &corrections, out)?;
    }
    Ok(())
}

/// The slices in `rect`, out of `slices`, ascending.
fn present(map: &DecisionMap, slices: usize, rect: Rect) -> Vec<u16> {
    let mut seen = vec![false; slices];
    for y in rect.y..rect.y + rect.height {
        let mut last = UNCOVERED;
        // most neighbours have the same slice, so several are compared at once
        for slices in map.slice.row(y)[rect.x..rect.x + rect.width].chunks(RUN) {
            if slices.first_chunk() == Some(&[last; RUN]) {
                continue;
            }
            for &slice in slices {
                last = slice;
                if let Some(seen) = seen.get_mut(usize::from(slice)) {
                    *seen = true;
                }
            }
        }
    }
    (0..slices).filter(|&slice| seen[slice]).map(|slice| slice as u16).collect()
}

/// How a pixel changes: `I` becomes `I + removed (I_a - I) + detail (I - D * I_b) + far_share (I_b - D * I_b)`.
struct Change {
    removed: f32,
    detail: f32,
    far_share: f32,
}

impl Change {
    /// The change of a pixel that near parts cover by `cover`, 0 to 1.
    fn covered(cover: f32, textured: bool) -> Self {
        let removed = defocus_spread::removed(cover);
        let detail = if textured { removed * defocus_spread::detail_gain(cover) } else { 0.0 };
        Self { removed, detail, far_share: 0.0 }
    }

    /// The change of a near pixel that shows the far part by `far_share`, 0 to 1.
    fn fattened(far_share: f32) -> Self {
        Self { removed: 0.0, detail: 0.0, far_share }
    }
}

/// Applies the corrections of one block, all between the slices `near` and `far`. Pixels that one of them does not
/// cover stay as they are.
fn apply<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &DecisionMap,
    model: &DefocusModel,
    rect: Rect,
    (near, far): (usize, usize),
    corrections: &[Correction],
    out: &mut [f32],
) -> Result<(), Interrupted> {
    let (width, height) = slices.size();
    let disc = Disc::new(model.radius(near, far));
    let fattened = corrections.iter().filter(|correction| correction.kind == Kind::Fattened);
    let fattened: Vec<usize> = fattened.map(|correction| correction.at).collect();
    let matte_rect = (!fattened.is_empty())
        .then(|| bounding_box(fattened.into_iter(), rect).grown(boundary_matte::REACH, width, height));
    let margin = matte_rect.map_or(0, |_| boundary_matte::REACH);
    let bounds = bounding_box(corrections.iter().map(|correction| correction.at), rect).grown(margin, width, height);
    // in the squares of the canvas, so that neither the tile nor the other pixels of the block matter
    let window = disc.window(bounds, width, height);
    let far_slice = slices.patch(far, window)?;
    let near_slice = slices.patch(near, if matte_rect.is_some() { window } else { bounds })?;
    let blurred = far_slice.blurred(&disc, bounds);
    let level = S::DEPTH.max() / 255.0;
    let matte = matte_rect.map(|matte_rect| {
        let near_blurred = near_slice.blurred(&disc, matte_rect);
        BoundaryMatte::new([&near_slice, &blurred], [&far_slice, &near_blurred], matte_rect, level)
    });
    let covers_all = slices.covers(near, bounds) && slices.covers(far, bounds);
    let beyond = MAX_BEYOND * level;
    for correction in corrections {
        let (x, y) = (rect.x + correction.at % rect.width, rect.y + correction.at / rect.width);
        let covers = |slice: usize| slices.coverage(slice).span(y).contains(&x);
        let is_covered = covers_all || (covers(near) && covers(far));
        if !is_covered {
            continue;
        }
        let Change { removed, detail, far_share } = match correction.kind {
            Kind::Covered(cover) => Change::covered(cover, map.textured.at(x, y)),
            Kind::Fattened => Change::fattened(matte.as_ref().map_or(0.0, |matte| matte.far_share(x, y))),
        };
        let (of_near, of_far, of_blurred) = (near_slice.index(x, y), far_slice.index(x, y), blurred.index(x, y));
        for (c, out) in out[correction.at * C..(correction.at + 1) * C].iter_mut().enumerate() {
            let (near, far) = (near_slice.channels[c].data[of_near], far_slice.channels[c].data[of_far]);
            let blurred = blurred.channels[c].data[of_blurred];
            let corrected = *out + removed * (near - *out) + detail * (*out - blurred) + far_share * (far - blurred);
            let (low, high) = (near.min(far).min(*out) - beyond, near.max(far).max(*out) + beyond);
            *out = corrected.clamp(low, high);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
