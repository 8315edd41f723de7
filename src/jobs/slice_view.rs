//! One slice of a stack for a viewer: warped to the reference slice and cropped, as its pixels entered the fused image.

use std::sync::Arc;

use super::{crop::crop_rect, input_bits::FullScaleSlices, requested};
use crate::contract::{Code, Fault, options::StackOptions};
use pinstack_science::{
    archive::ArchiveLimits,
    fusion::warped_slice,
    imaging::Raster,
    types::{ReadAt, profile::ProfileInput},
};

/// The light of a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SliceLight {
    /// The front light.
    Front,
    /// The back light.
    Back,
    /// The further light with this index in the layout of the stack.
    Further(usize),
}

/// Slice `index`, in the order of fusion, of a light of the zip `archive`. Memory: the slice before and after the warp.
///
/// # Errors
/// Those of the archive, of the decoder and of [`warped_slice`]; [`Code::NotFound`] for a light that the zip lacks.
pub fn slice_view(
    archive: Arc<dyn ReadAt>,
    profile: &ProfileInput,
    options: &StackOptions,
    (light, index): (SliceLight, usize),
    limits: &ArchiveLimits,
) -> Result<Raster, Fault> {
    let archive = requested::archive(archive, options, limits)?;
    let slices = match light {
        SliceLight::Front => Some(archive.front()),
        SliceLight::Back => Some(archive.back()),
        SliceLight::Further(at) => archive.lights().get(at).map(|(_, slices)| slices),
    };
    let slices = slices.ok_or_else(|| Fault::new(Code::NotFound, "the zip of the stack has no such light"))?;
    let slices = FullScaleSlices::of(slices, options.input_bits);
    let warped = warped_slice(&slices, &requested::plan(options, profile), index)?;
    Ok(warped.crop(crop_rect(options.crop, profile)?))
}
