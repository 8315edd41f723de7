//! The disk space that a job needs while it runs, without its upload. It is known before the upload arrives, because
//! the profile has the size and the number of the slices.

use crate::contract::{
    artifact::{PixelSizes, StackArtifact},
    options::HeightMode,
    request::{JobRequest, StackRequest},
};
use pinstack_science::{
    fusion::Plan,
    imaging::Depth,
    types::{
        fusion_options::{GuidedParams, Method},
        profile::ProfileInput,
    },
};

/// Constant part: small pictures, documents, and the overhead of the file system.
const BASE: u64 = 16 << 20;
/// Most bytes of the small copy of a slice that a calibration keeps, and of the overlay made of it.
const COPY: u64 = 2 * 1600 * 1600 * 3;

/// Upper bound of the bytes that a job writes.
///
/// - A stack: the scratch file of one light ([`Plan::scratch_bytes`]; that of the next light replaces it, and is not
///   larger), and the uncompressed results: image with alpha, mask, fused back light, index of the sharpest slice,
///   height map if it was asked for, and a picture like the image for each further light.
/// - A calibration: a small copy and an overlay of each slice.
/// - A reconstruction: the database of COLMAP, its models and the files made of them.
pub fn disk_need(request: &JobRequest) -> u64 {
    match request {
        JobRequest::Stack(request) => of_request(request),
        JobRequest::Calibration(request) => calibration(request.layout.front.len()),
        JobRequest::Reconstruction(request) => super::reconstruction::need::disk(request),
    }
}

fn of_request(request: &StackRequest) -> u64 {
    let (layout, options) = (&request.layout, &request.options);
    let plan = Plan {
        method: options.method,
        ..Plan::aligned(layout.width as usize, layout.height as usize, layout.front.len())
    };
    let format = Format {
        channels: layout.channels.into(),
        depth: if layout.bit_depth > 8 { Depth::Sixteen } else { Depth::Eight },
    };
    let image_sample = options.bit_depth.sample_bytes(layout.bit_depth);
    let image = layout.lights.len() as u64 * StackArtifact::Image.pixel_bytes(&sizes(&format, image_sample));
    let lights = image.saturating_mul(u64::from(layout.width) * u64::from(layout.height));
    stack(&plan, &format, image_sample, options.height != HeightMode::None).saturating_add(lights)
}

/// The same for a stack of which only the profile is known. Assumes 8-bit colour, a height map, and the method with the
/// largest scratch file.
pub fn disk_need_by_profile(profile: &ProfileInput) -> u64 {
    let plan = Plan::from_profile(profile, Method::HaloCorrected, GuidedParams::default());
    stack(&plan, &Format { channels: 3, depth: Depth::Eight }, 1, true)
}

/// The sample format of the slices.
struct Format {
    channels: usize,
    depth: Depth,
}

fn sizes(format: &Format, image_sample: u64) -> PixelSizes {
    PixelSizes { image_sample, slice_pixel: (format.channels * format.depth.bytes()) as u64 }
}

/// `image_sample`: bytes per sample of the image; `height`: with a height map.
fn stack(plan: &Plan, format: &Format, image_sample: u64, height: bool) -> u64 {
    let scratch = plan.scratch_bytes(format.channels, format.depth);
    let sizes = sizes(format, image_sample);
    let made = StackArtifact::ALL.iter().filter(|artifact| height || !artifact.needs_height());
    let results: u64 = made.map(|artifact| artifact.pixel_bytes(&sizes)).sum();
    let pixels = (plan.width as u64).saturating_mul(plan.height as u64);
    BASE.saturating_add(scratch).saturating_add(pixels.saturating_mul(results))
}

fn calibration(slices: usize) -> u64 {
    BASE.saturating_add(COPY.saturating_mul(slices as u64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::request::Upload;
    use pinstack_science::types::{
        Homography,
        stack_layout::{FurtherLight, StackLayout},
    };

    /// A stack of ten colour slices.
    fn stack(width: u32, height: u32, bit_depth: u8, method: Method) -> JobRequest {
        let mut request = StackRequest {
            options: Default::default(),
            profile_revision: 1,
            profile_digest: String::new(),
            profile_optics_digest: None,
            upload: Upload { key: String::new(), bytes: 0, sha256: String::new(), filename: None },
            layout: StackLayout {
                front: vec![String::new(); 10],
                back: vec![],
                lights: vec![],
                moved: vec![],
                width,
                height,
                bit_depth,
                channels: 3,
                orientation: 1,
                largest_file_bytes: 0,
            },
            rerun_of: None,
        };
        request.options.method = method;
        JobRequest::Stack(request)
    }

    #[test]
    fn the_scratch_file_is_reserved_with_its_padding_and_its_cells() {
        // 33 x 65 px are 2 x 3 blocks of 32 px; 9 x 17 cells are one block
        let results = 33 * 65 * (4 + 1 + 3 + 2);
        let samples = 2 * 3 * 32 * 32 * 3;
        let need = |bit_depth, method| disk_need(&stack(33, 65, bit_depth, method)) - BASE;
        assert_eq!(need(8, Method::Guided), 10 * samples + results);
        assert_eq!(need(8, Method::Pyramid), 10 * samples + results);
        assert_eq!(need(8, Method::HaloCorrected), 10 * (samples + 32 * 32) + results);
        assert!(need(16, Method::Guided) >= 10 * 2 * samples + results);
    }

    #[test]
    fn each_further_light_is_a_picture_like_the_image() {
        let need = |lights: usize, bit_depth| {
            let JobRequest::Stack(mut request) = stack(33, 65, bit_depth, Method::HaloCorrected) else {
                panic!("a stack")
            };
            let light = FurtherLight { name: "uv".into(), slices: request.layout.front.clone() };
            request.layout.lights = vec![light; lights];
            disk_need(&JobRequest::Stack(request))
        };
        assert_eq!(need(3, 8) - need(0, 8), 3 * 33 * 65 * 4);
    }

    #[test]
    fn the_need_by_profile_is_that_of_the_largest_stack_in_8_bit_colour() {
        let profile = ProfileInput {
            image_width: 33,
            image_height: 65,
            homographies: vec![Homography::IDENTITY; 10],
            ..ProfileInput::default()
        };
        let by_profile = disk_need_by_profile(&profile);
        for method in Method::ALL {
            let JobRequest::Stack(mut request) = stack(33, 65, 8, method) else { panic!("a stack") };
            request.options.height = HeightMode::Auto;
            let need = disk_need(&JobRequest::Stack(request));
            assert!(by_profile >= need, "{method:?}: {by_profile} for {need}");
            assert_eq!(by_profile == need, method == Method::HaloCorrected, "{method:?}");
        }
    }
}
