//! What the options of a stack request of the science.

use std::sync::Arc;

use crate::contract::{
    input::SliceOrder,
    options::{LateralColourMode, StackOptions},
    outcome::HeightInfo,
};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    fusion::{
        Plan,
        height::{HeightMap, INVALID},
    },
    segmentation::MaskParams,
    types::{Error, ReadAt, fusion_options::GuidedParams, profile::ProfileInput},
};

/// The archive with its slices in the order of fusion.
///
/// # Errors
/// As [`archive::open_shared`].
pub(super) fn archive(
    zip: Arc<dyn ReadAt>,
    options: &StackOptions,
    limits: &ArchiveLimits,
) -> Result<StackArchive, Error> {
    let archive = archive::open_shared(zip, limits)?;
    Ok(match options.order {
        SliceOrder::Name => archive,
        SliceOrder::Reverse => archive.reversed(),
    })
}

/// How a stack with these options is fused with the profile `profile`.
pub(super) fn plan(options: &StackOptions, profile: &ProfileInput) -> Plan {
    let &StackOptions { method, r1, eps1, r2, eps2, average, r_g, sigma_g, .. } = options;
    let plan = Plan::from_profile(profile, method, GuidedParams { r1, eps1, r2, eps2, average, r_g, sigma_g });
    match options.lateral_colour {
        LateralColourMode::Correct => plan,
        LateralColourMode::Keep => Plan { lateral_colour: None, ..plan },
    }
}

/// The parameters of the mask for a picture of `width` x `height` px.
pub fn mask_params(options: &StackOptions, width: usize, height: usize) -> MaskParams {
    let default = MaskParams::default_for(width, height);
    MaskParams {
        threshold: options.mask_threshold,
        min_blob_px: options.mask_min_blob_px.unwrap_or(default.min_blob_px),
        min_hole_px: options.mask_min_hole_px.unwrap_or(default.min_hole_px),
        edge: options.mask_edge,
    }
}

/// The description of `map`.
pub(super) fn height_info(map: &HeightMap) -> HeightInfo {
    let &HeightMap { unit, direction, offset, scale, median_sigma, valid_fraction, .. } = map;
    HeightInfo { unit, direction, offset, scale, invalid: INVALID, median_sigma, valid_fraction }
}
