//! The disk space that a job needs while it runs, without its upload. It is known before the upload arrives, because
//! the profile has the size and the number of the slices.

use crate::contract::{
    artifact::{PixelSizes, StackArtifact},
    options::HeightMode,
    request::JobRequest,
};
use pinstack_science::types::{profile::ProfileInput, stack_layout::StackLayout};

/// Constant part: small pictures, documents, and the overhead of the file system.
const BASE: u64 = 16 << 20;
/// Most bytes of the small copy of a slice that a calibration keeps, and of the overlay made of it.
const COPY: u64 = 2 * 1600 * 1600 * 3;

/// Upper bound of the bytes that a job writes.
///
/// - A stack: the raw warped slices of one light (those of the second light replace those of the first), and the
///   uncompressed results: image with alpha, mask, fused back light, index of the sharpest slice,
///   height map if it was asked for.
/// - A calibration: a small copy and an overlay of each slice.
pub fn disk_need(request: &JobRequest) -> u64 {
    match request {
        JobRequest::Stack(request) => {
            let slices = Slices::of_layout(&request.layout);
            let image_sample = request.options.bit_depth.sample_bytes(request.layout.bit_depth);
            stack(&slices, image_sample, request.options.height != HeightMode::None)
        }
        JobRequest::Calibration(request) => calibration(request.layout.front.len()),
    }
}

/// The same for a stack of which only the profile is known. Assumes 8-bit colour and a height map.
pub fn disk_need_by_profile(profile: &ProfileInput) -> u64 {
    let slices = Slices {
        pixels: u64::from(profile.image_width) * u64::from(profile.image_height),
        count: profile.homographies.len() as u64,
        bytes_per_pixel: 3,
    };
    stack(&slices, 1, true)
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

/// `image_sample`: bytes per sample of the image; `height`: with a height map.
fn stack(slices: &Slices, image_sample: u64, height: bool) -> u64 {
    let warped = slices.count.saturating_mul(slices.bytes_per_pixel);
    let sizes = PixelSizes { image_sample, slice_pixel: slices.bytes_per_pixel };
    let made = StackArtifact::ALL.iter().filter(|artifact| height || !artifact.needs_height());
    let results: u64 = made.map(|artifact| artifact.pixel_bytes(&sizes)).sum();
    BASE.saturating_add(slices.pixels.saturating_mul(warped.saturating_add(results)))
}

fn calibration(slices: usize) -> u64 {
    BASE.saturating_add(COPY.saturating_mul(slices as u64))
}

fn sample(layout: &StackLayout) -> u64 {
    if layout.bit_depth > 8 { 2 } else { 1 }
}
