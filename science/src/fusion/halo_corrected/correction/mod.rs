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
    pixel_groups::{bounding_box, in_blocks},
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
    let mut corrections = Corrections::new();
    let fattened = fattening::find(map, model, slices.count(), rect, &mut corrections);
    defocus_spread::find(map, model, slices.control(), rect, &covering, &fattened, &mut corrections)?;
    for ((near, far), corrections) in corrections.finish() {
        let pair = (usize::from(near), usize::from(far));
        let disc = Disc::new(model.radius(pair.0, pair.1));
        for (bounds, corrections) in in_blocks(&corrections, |correction| correction.at, rect, disc.reach()) {
            apply(slices, map, rect, (pair, &disc), (bounds, &corrections), out)?;
        }
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

/// Applies the corrections of one block, all between the slices `near` and `far`, and within `bounds`. Pixels that one
/// of the slices does not cover stay as they are.
fn apply<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &DecisionMap,
    rect: Rect,
    ((near, far), disc): ((usize, usize), &Disc),
    (bounds, corrections): (Rect, &[Correction]),
    out: &mut [f32],
) -> Result<(), Interrupted> {
    let (width, height) = slices.size();
    let bounds_of = |sought: &dyn Fn(&Correction) -> bool, margin| {
        let mut found = corrections.iter().filter(|correction| sought(correction)).map(|correction| correction.at);
        let first = found.next()?;
        Some(bounding_box(std::iter::once(first).chain(found), rect).grown(margin, width, height))
    };
    let place = |at: usize| (rect.x + at % rect.width, rect.y + at / rect.width);
    let matte_rect = bounds_of(&|correction| correction.kind == Kind::Fattened, boundary_matte::REACH);
    let margin = matte_rect.map_or(0, |_| boundary_matte::REACH);
    let bounds = bounds.grown(margin, width, height);
    // where the blur of the far slice matters: not at covered pixels without texture
    let has_detail = |correction: &Correction| {
        let (x, y) = place(correction.at);
        correction.kind == Kind::Fattened || map.textured.at(x, y)
    };
    let blurred_rect = bounds_of(&has_detail, margin);
    // in the squares of the canvas, so that neither the tile nor the other pixels of the block matter
    let with_blur_in = |part: Option<Rect>| {
        let window = part.map_or(bounds, |part| disc.window(part, width, height).joined(bounds));
        window.in_squares(disc.square_side(), width, height)
    };
    let far_slice = slices.patch(far, with_blur_in(blurred_rect))?;
    let near_slice = slices.patch(near, with_blur_in(matte_rect))?;
    let blurred = blurred_rect.map(|part| far_slice.blurred(disc, part));
    let level = S::DEPTH.max() / 255.0;
    let matte = matte_rect.zip(blurred.as_ref()).map(|(matte_rect, blurred)| {
        let near_blurred = near_slice.blurred(disc, matte_rect);
        BoundaryMatte::new([&near_slice, blurred], [&far_slice, &near_blurred], matte_rect, level)
    });
    let covers_all = slices.covers(near, bounds) && slices.covers(far, bounds);
    let beyond = MAX_BEYOND * level;
    for correction in corrections {
        let (x, y) = place(correction.at);
        let covers = |slice: usize| slices.coverage(slice).span(y).contains(&x);
        let is_covered = covers_all || (covers(near) && covers(far));
        if !is_covered {
            continue;
        }
        let Change { removed, detail, far_share } = match correction.kind {
            Kind::Covered(cover) => Change::covered(cover, map.textured.at(x, y)),
            Kind::Fattened => Change::fattened(matte.as_ref().map_or(0.0, |matte| matte.far_share(x, y))),
        };
        let (of_near, of_far) = (near_slice.index(x, y), far_slice.index(x, y));
        let blurred = blurred.as_ref().filter(|_| has_detail(correction)).map(|blurred| (blurred, blurred.index(x, y)));
        for (c, out) in out[correction.at * C..(correction.at + 1) * C].iter_mut().enumerate() {
            let (near, far) = (near_slice.channels[c].data[of_near], far_slice.channels[c].data[of_far]);
            let blurred = blurred.map_or(*out, |(blurred, at)| blurred.channels[c].data[at]);
            let corrected = *out + removed * (near - *out) + detail * (*out - blurred) + far_share * (far - blurred);
            let (low, high) = (near.min(far).min(*out) - beyond, near.max(far).max(*out) + beyond);
            *out = corrected.clamp(low, high);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
