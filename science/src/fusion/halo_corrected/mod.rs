//! Fusion by labels: each pixel from the slice in which it is sharp, and the veil of near parts taken off.
//!
//! Every mosaic of slices has a halo where a near part overlaps a far one: in each slice that shows the far part
//! sharp, the near part's blur lies over it. The slices of a calibrated stack say how large that blur is, and
//! the slice of the near part shows the place unveiled. See [`veil`] for the formula, [`labels`] for what decides
//! which slice a pixel is from, and [`trust`] for where pyramids do better.

mod bounds;
mod calm;
mod labels;
mod optics;
mod outline;
mod overreach;
mod pictures;
mod squares;
mod survey;
mod tasks;
mod tile;
mod trust;
mod veil;

pub(super) use survey::Survey;

use super::{Run, align::Aligned, blend::Blended, pyramid};
use crate::{
    imaging::{Plane, Sample},
    types::Interrupted,
};
use labels::DETAIL;
use optics::Optics;
use pictures::Pictures;

/// Runs the second pass and the labels before it; says from which slice each pixel comes.
pub(super) fn fuse<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
    energy: &Plane<f32>,
    survey: Survey,
) -> Result<(Blended<S>, Plane<u16>), Interrupted> {
    run.control.check()?;
    let pictures = Pictures::<S, C>::new(aligned, run.control);
    let surveyed = survey.finish(run.plan.reference);
    let sure = energy.map(|energy| energy > DETAIL * surveyed.noise);
    let plan = run.plan;
    let optics = Optics::measure(&pictures, &aligned.index, &sure, plan.rail.as_deref(), plan.near_first)?;
    let labels = labels::refine(&pictures, &aligned.index, sure, energy, &surveyed, &optics)?;
    let pyramids = pyramid::blend::<S, C>(run, aligned)?;
    // without the blur labels are doubted nowhere, and no veil can be taken off
    if !optics.is_known() {
        return Ok((pyramids, labels.slice));
    }
    let mut blended = tile::blend(run, &pictures, &labels, &optics, &pyramids.pixels)?;
    blended.clamped = blended.clamped.max(pyramids.clamped);
    Ok((blended, labels.slice))
}
