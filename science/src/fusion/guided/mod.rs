//! Second pass of [`Method::Guided`](crate::types::fusion_options::Method): guided filtering fusion (Li, Kang & Hu,
//! IEEE TIP 2013), the method of Li & Nguyen (DICTA 2019).
//!
//! In: the warped slices and the sharpest slice per pixel. Out: the fused image. With `I_n` the samples of slice `n`,
//! `P_n` 1 where slice `n` is the sharpest and else 0, and `G(r, eps)` the guided filter (He, Sun & Tang, TPAMI 2013)
//! guided by the luma of slice `n`:
//!
//! ```text
//! B_n   = mean of I_n over a window of `average` px      base layer
//! D_n   = I_n - B_n                                      detail layer
//! WB_n  = clamp(G(r1, eps1) P_n, 0, 1)                   weight of the base layer
//! WD_n  = clamp(G(r2, eps2) P_n, 0, 1)                   weight of the detail layer
//! F     = sum WB_n B_n / sum WB_n + sum WD_n D_n / sum WD_n
//! ```
//!
//! Work is saved where it cannot change a bit: a slice that is the sharpest nowhere within reach of its filters has the
//! weight 0 and is skipped ([`presence`]), and where only one slice remains, `F` is that slice and is copied.

mod layers;
mod presence;
mod tile;

use super::{
    align::Aligned,
    run::Run,
    shown,
    tiles::{Blended, in_tiles},
};
use crate::{imaging::Sample, types::Interrupted};
use presence::Presence;
use tile::TileBlender;

/// Runs the second pass.
pub(super) fn blend<S: Sample, const C: usize>(run: &Run<'_>, aligned: &Aligned) -> Result<Blended<S>, Interrupted> {
    let presence = Presence::new(&aligned.index, aligned.coverages.len());
    let blender = || TileBlender::<S>::new(&run.plan.params);
    in_tiles::<S, C, _>((run, aligned, shown::MARGIN), "fusing", blender, |blender, rect, out| {
        blender.tile::<C>(rect, aligned, &presence, run.control, out)
    })
}
