//! One slice of a stack for a viewer: warped to the reference slice and cropped, as its pixels entered the fused image.

use std::sync::Arc;

use super::{crop::crop_rect, input_bits::FullScaleSlices, requested};
use crate::contract::{Fault, options::StackOptions};
use pinstack_science::{
    archive::ArchiveLimits,
    fusion::warped_slice,
    imaging::Raster,
    types::{ReadAt, profile::ProfileInput},
};

/// Slice `index`, in the order of fusion, of the front light of the zip `archive`. Memory: the slice before and
/// after the warp.
///
/// # Errors
/// Those of the archive, of the decoder and of [`warped_slice`].
pub fn slice_view(
    archive: Arc<dyn ReadAt>,
    profile: &ProfileInput,
    options: &StackOptions,
    index: usize,
    limits: &ArchiveLimits,
) -> Result<Raster, Fault> {
    let archive = requested::archive(archive, options, limits)?;
    let slices = FullScaleSlices::of(archive.front(), options.input_bits);
    let warped = warped_slice(&slices, &requested::plan(options, profile), index)?;
    Ok(warped.crop(crop_rect(options.crop, profile)?))
}
