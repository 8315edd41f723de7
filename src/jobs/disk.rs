//! How much room on the disk a job needs while it runs, beyond its upload. Known before the first byte of the upload
//! arrives, because the profile says how large and how many the slices are.

use crate::contract::{
    artifact::{PixelSizes, StackArtifact},
    request::JobRequest,
};
use pinstack_science::types::{profile::ProfileInput, stack_layout::StackLayout};

/// Small pictures, documents, and what files of this size take of a file system besides their bytes.
const BASE: u64 = 16 << 20;
/// Most bytes of the small copy of a slice that a calibration keeps, and of the overlay made of it.
const COPY: u64 = 2 * 1600 * 1600 * 3;

/// Bytes that a job may write at most before it has ended.
///
/// - A stack: the warped slices of one light (the second takes the place of the first), raw, and the results as if nothing
///   of them could be compressed: image with alpha, mask, fused back light, index of the sharpest slice.
/// - A calibration: a small copy and an overlay of each slice.
pub fn disk_need(request: &JobRequest) -> u64 {
    match request {
        JobRequest::Stack(request) => {
            let slices = Slices::of_layout(&request.layout);
            stack(&slices, request.options.bit_depth.sample_bytes(request.layout.bit_depth))
        }
        JobRequest::Calibration(request) => calibration(request.layout.front.len()),
    }
}

/// The same for a stack of which only the profile is known: 8-bit colour is assumed.
pub fn disk_need_by_profile(profile: &ProfileInput) -> u64 {
    let slices = Slices {
        pixels: u64::from(profile.image_width) * u64::from(profile.image_height),
        count: profile.homographies.len() as u64,
        bytes_per_pixel: 3,
    };
    stack(&slices, 1)
}

struct Slices {
    pixels: u64,
    count: u64,
    bytes_per_pixel: u64,
}

impl Slices {
    fn of_layout(layout: &StackLayout) -> Self {
        Self {
            pixels: u64::from(layout.width) * u64::from(layout.height),
            count: layout.front.len() as u64,
            bytes_per_pixel: u64::from(layout.channels) * sample(layout),
        }
    }
}

/// `image_sample`: bytes per sample of the image.
fn stack(slices: &Slices, image_sample: u64) -> u64 {
    let warped = slices.count.saturating_mul(slices.bytes_per_pixel);
    let sizes = PixelSizes { image_sample, slice_pixel: slices.bytes_per_pixel };
    let results: u64 = StackArtifact::ALL.iter().map(|artifact| artifact.pixel_bytes(&sizes)).sum();
    BASE.saturating_add(slices.pixels.saturating_mul(warped.saturating_add(results)))
}

fn calibration(slices: usize) -> u64 {
    BASE.saturating_add(COPY.saturating_mul(slices as u64))
}

fn sample(layout: &StackLayout) -> u64 {
    if layout.bit_depth > 8 { 2 } else { 1 }
}
