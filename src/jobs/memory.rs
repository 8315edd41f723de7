//! The peak memory of a job, computed from the layout of its slices.

use crate::contract::{
    artifact::{PixelSizes, StackArtifact},
    options::HeightMode,
    request::{CalibrationRequest, JobRequest, StackRequest},
};
use pinstack_science::{
    calibration::{MAX_SAMPLES, SLICE_BYTES, STACKS_BYTES},
    fusion::{self, Decision, Plan, height::axis::HeightAxis},
    imaging::Depth,
    types::{calibration_options::CalibrationSource, mask_options::MaskEdge, stack_layout::StackLayout},
};

/// Constant part: the directory of the archive, codecs, thread stacks.
const BASE: u64 = 64 << 20;

/// Peak memory of a job with `threads` threads, bytes. In addition to the terms below, each slice in flight takes twice
/// the largest file: its buffer may be twice as large, because it grows while a compressed file is read.
///
/// - A stack: the largest of three phases: the fusion ([`Plan::memory_bytes`]) with the silhouette; the compositing
///   (fused picture, its index, validity, silhouette and heights, and the RGBA picture); or, one after the other, the
///   further lights (the fusion and the compositing of one, with what decided the fusion of the front light, silhouette
///   and opacity). None grows with the number of slices, because warped slices are kept in files, or of lights.
/// - A calibration: for each slice in flight (one above and one below the reference) the samples while it is decoded
///   and the planes of the detector, whose size is bounded; and for each slice its dots and its fingerprint
///   ([`SLICE_BYTES`]).
/// - A reconstruction: COLMAP, mostly while each thread extracts the features of an image.
pub fn memory_need(request: &JobRequest, threads: usize) -> u64 {
    let peak = match request {
        JobRequest::Stack(request) => stack(request, threads),
        JobRequest::Calibration(request) => calibration(request, threads),
        JobRequest::Reconstruction(request) => super::reconstruction::need::memory(request, threads),
    };
    BASE.saturating_add(peak)
}

fn stack(request: &StackRequest, threads: usize) -> u64 {
    let layout = &request.layout;
    let slices = layout.front.len();
    let with_height = request.options.height != HeightMode::None;
    let plan = Plan {
        method: request.options.method,
        height_map: with_height.then(|| HeightAxis::steps(slices, 0, None)),
        ..Plan::aligned(layout.width as usize, layout.height as usize, slices)
    };
    // a hard and, when it is asked for, a soft one
    let silhouettes = match request.options.mask_edge {
        _ if layout.back.is_empty() => 0,
        MaskEdge::Hard => 1,
        MaskEdge::Soft => 2,
    };
    let decision = if layout.lights.is_empty() { 0 } else { Decision::BYTES_PER_PIXEL };
    // what is kept from fusion to fusion
    let kept = silhouettes + decision;
    let fusing = plan.memory_bytes(threads, depth(layout), true).saturating_add(kept * pixels(layout));
    let slice_pixel = 3 * sample(layout);
    let image_sample = request.options.bit_depth.sample_bytes(layout.bit_depth);
    let sizes = PixelSizes { image_sample, slice_pixel };
    // data are encoded one after the other, beside the image; the back light is written before
    let data = |of: &StackArtifact| !matches!(of, StackArtifact::Image | StackArtifact::Backlight);
    let data = StackArtifact::ALL.into_iter().filter(data).map(|of| of.pixel_bytes(&sizes)).max();
    // height and deviation of a pixel, 4 bytes; the one of them that is being encoded, 2 bytes
    let heights = if with_height { 4 + 2 } else { 0 };
    let outputs = StackArtifact::Image.pixel_bytes(&sizes) + data.unwrap_or_default();
    // the fused picture; validity and alpha; the outputs
    let composing = slice_pixel + 2 + kept + heights + outputs;
    let composing = pixels(layout).saturating_mul(composing);
    let of_a_light = if layout.lights.is_empty() {
        0
    } else {
        let written = pixels(layout).saturating_mul(slice_pixel + StackArtifact::Image.pixel_bytes(&sizes));
        let fusing = plan.for_further_light().memory_bytes(threads, depth(layout), true).max(written);
        // and opacity
        fusing.saturating_add((kept + 1) * pixels(layout))
    };
    let fusing = fusing.max(of_a_light).saturating_add(files(layout, fusion::slices_in_flight(threads, slices)));
    fusing.max(composing)
}

/// The buffers of the files of the slices in flight.
fn files(layout: &StackLayout, in_flight: usize) -> u64 {
    layout.largest_file_bytes.saturating_mul(2 * in_flight as u64)
}

fn calibration(request: &CalibrationRequest, threads: usize) -> u64 {
    let layout = &request.layout;
    let slices = threads.clamp(1, 2);
    let in_flight = slices as u64;
    let decoded = decoded_samples(layout) * sample(layout);
    let samples = pixels(layout).min(MAX_SAMPLES as u64);
    // six planes of floats, four of bytes, and one of both while dots are told from what is not
    let planes = samples * in_flight * (6 * 4 + 4 + 8);
    let kept = (SLICE_BYTES as u64).saturating_mul((layout.front.len() + layout.moved.len()) as u64);
    let decoding = pixels(layout).saturating_mul(in_flight * decoded);
    let kept = match request.options.source {
        CalibrationSource::DotTarget => planes.saturating_add(kept),
        CalibrationSource::Stacks => STACKS_BYTES as u64,
    };
    decoding.saturating_add(kept).saturating_add(files(layout, slices))
}

/// Samples per pixel that decoding a slice with `c` channels holds at most. As in [`Plan::memory_bytes`], these are the
/// samples before alpha is dropped and a copy after it, which the orientation makes: at most `2 c + 1`. With 8 bits a
/// progressive JPEG needs more: coefficients of 16 bits beside the samples, as much as three copies.
fn decoded_samples(layout: &StackLayout) -> u64 {
    let channels = u64::from(layout.channels);
    match depth(layout) {
        Depth::Eight => 3 * channels,
        Depth::Sixteen => 2 * channels + 1,
    }
}

fn pixels(layout: &StackLayout) -> u64 {
    u64::from(layout.width) * u64::from(layout.height)
}

fn depth(layout: &StackLayout) -> Depth {
    if layout.bit_depth > 8 { Depth::Sixteen } else { Depth::Eight }
}

fn sample(layout: &StackLayout) -> u64 {
    depth(layout).bytes() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        contract::request::Upload,
        jobs::{JobRunner, ScienceRunner},
    };
    use pinstack_science::types::{
        calibration_options::CalibrationOptions, fusion_options::Method, stack_layout::FurtherLight,
    };

    fn layout(slices: usize, width: u32, bit_depth: u8) -> StackLayout {
        StackLayout {
            front: vec![String::new(); slices],
            back: vec![],
            lights: vec![],
            moved: vec![],
            width,
            height: 4000,
            bit_depth,
            channels: 3,
            orientation: 1,
            largest_file_bytes: 0,
        }
    }

    fn upload() -> Upload {
        Upload { key: String::new(), bytes: 0, sha256: String::new(), filename: None }
    }

    fn stack(slices: usize, width: u32, bit_depth: u8) -> JobRequest {
        JobRequest::Stack(StackRequest {
            options: Default::default(),
            profile_revision: 1,
            profile_digest: String::new(),
            profile_optics_digest: None,
            upload: upload(),
            layout: layout(slices, width, bit_depth),
            rerun_of: None,
        })
    }

    fn calibration(slices: usize, width: u32, bit_depth: u8) -> JobRequest {
        let (options, layout) = (CalibrationOptions::default(), layout(slices, width, bit_depth));
        JobRequest::Calibration(CalibrationRequest { options, upload: upload(), layout, stacks: vec![] })
    }

    #[test]
    fn memory_grows_with_the_pixels_and_with_the_dots_of_each_slice() {
        for request in [stack, calibration] {
            let need = |slices, width, depth| memory_need(&request(slices, width, depth), 4);
            let per_slice = if let JobRequest::Stack(_) = request(1, 1, 8) { 0 } else { SLICE_BYTES as u64 };
            assert_eq!(need(10, 6000, 8) + 190 * per_slice, need(200, 6000, 8));
            assert!(need(10, 6000, 16) > need(10, 6000, 8));
            assert!(need(10, 12_000, 8) > need(10, 6000, 8));
            assert!(need(10, 6000, 8) > 24_000_000 * 10);
        }
    }

    #[test]
    fn a_job_gets_as_many_threads_as_fit_into_the_memory_and_at_least_one() {
        let job = stack(10, 6000, 8);
        let need = |memory| ScienceRunner { threads: 8, memory, ..ScienceRunner::default() }.memory_need(&job);
        assert_eq!(need(None), memory_need(&job, 8));
        for threads in [3, 8] {
            assert_eq!(need(Some(memory_need(&job, threads))), memory_need(&job, threads));
        }
        assert_eq!(need(Some(memory_need(&job, 3) - 1)), memory_need(&job, 2));
        assert_eq!(need(Some(1)), memory_need(&job, 1));
    }

    #[test]
    fn a_height_map_never_lowers_the_need() {
        for method in Method::ALL {
            let need = |height| {
                let JobRequest::Stack(mut request) = stack(10, 6000, 8) else { panic!("a stack") };
                (request.options.height, request.options.method) = (height, method);
                memory_need(&JobRequest::Stack(request), 1)
            };
            assert!(need(HeightMode::Auto) >= need(HeightMode::None), "{method:?}");
            // two planes of floats and the map of 4 bytes beside the fused picture and its index
            assert!(need(HeightMode::Auto) >= 24_000_000 * (8 + 4 + 3 + 3), "{method:?}");
        }
    }

    #[test]
    fn the_files_in_flight_are_counted_with_a_copy_of_each() {
        let with_files = |mut request: JobRequest, threads| {
            let before = memory_need(&request, threads);
            match &mut request {
                JobRequest::Stack(request) => request.layout.largest_file_bytes = 50_000_000,
                JobRequest::Calibration(request) => request.layout.largest_file_bytes = 50_000_000,
                JobRequest::Reconstruction(_) => panic!("it has no slices"),
            }
            memory_need(&request, threads) - before
        };
        assert_eq!(with_files(stack(10, 3000, 8), 1), 100_000_000);
        assert_eq!(with_files(stack(10, 3000, 8), 8), 400_000_000);
        assert_eq!(with_files(calibration(10, 3000, 8), 8), 200_000_000);
    }

    #[test]
    fn a_calibration_counts_the_copies_that_decoding_makes() {
        // both pictures are larger than what the detector looks at
        let per_pixel = |bit_depth, threads| {
            let need = |width| memory_need(&calibration(10, width, bit_depth), threads);
            (need(12_000) - need(6000)) / 24_000_000
        };
        // three copies of 8 bits; of 16 bits two, and the alpha of one
        assert_eq!([per_pixel(8, 1), per_pixel(16, 1)], [3 * 3, (3 + 4) * 2]);
        assert_eq!(per_pixel(8, 8), 2 * 9, "two slices in flight");
        let JobRequest::Calibration(mut request) = calibration(10, 6000, 8) else { panic!("a calibration") };
        let colour = memory_need(&JobRequest::Calibration(request.clone()), 1);
        request.layout.channels = 1;
        let grey = memory_need(&JobRequest::Calibration(request), 1);
        assert_eq!(colour - grey, 24_000_000 * 6);
    }

    #[test]
    fn further_lights_cost_what_decides_them_and_one_is_fused_at_a_time() {
        let need = |lights: usize, threads| {
            let JobRequest::Stack(mut request) = stack(10, 6000, 8) else { panic!("a stack") };
            let light = FurtherLight { name: "uv".into(), slices: request.layout.front.clone() };
            request.layout.lights = vec![light; lights];
            memory_need(&JobRequest::Stack(request), threads)
        };
        for threads in [1, 8] {
            assert_eq!(need(1, threads), need(16, threads));
            let decision = 24_000_000 * Decision::BYTES_PER_PIXEL;
            assert_eq!(need(1, threads) - need(0, threads), decision + if threads == 8 { 24_000_000 } else { 0 });
        }
    }

    #[test]
    fn a_back_light_costs_the_silhouette() {
        let front = stack(10, 6000, 8);
        let JobRequest::Stack(mut request) = front.clone() else { panic!("a stack") };
        request.layout.back = request.layout.front.clone();
        assert_eq!(memory_need(&JobRequest::Stack(request.clone()), 4), memory_need(&front, 4) + 24_000_000);
        request.options.mask_edge = MaskEdge::Soft;
        assert_eq!(memory_need(&JobRequest::Stack(request), 4), memory_need(&front, 4) + 48_000_000);
    }
}
