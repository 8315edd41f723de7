//! Whole stacks through the job, held against the truth of the renderer.

use super::*;
use crate::{
    contract::{
        options::{BitDepth, Crop, HeightMode, ImageFormat, StackOptions, UnderAlpha},
        outcome::ImageInfo,
        request::JobRequest,
    },
    jobs::testkit::{Recorder, TestJob, both_zip, file, front_zip, picture, png, stack, zip},
    store::digest::hex,
};
use pinstack_science::{
    imaging::{Raster, Rect, Samples},
    types::{
        fusion_options::Method,
        intrinsics::Intrinsics,
        mask_options::{MaskEdge, MaskThreshold},
        metrics::Metrics,
    },
};
use sha2::{Digest, Sha256};

mod colours;
mod further_lights;
mod lateral_colour;
mod pictures;

fn run_with(job: &TestJob, sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
    let JobRequest::Stack(request) = &job.context.job.request else { panic!("a stack") };
    run(&job.context, request, &ArchiveLimits::default(), sink)
}

fn done(job: &TestJob) -> (JobOutput, StackOutcome) {
    let output = run_with(job, &Recorder::default()).expect("the job");
    let JobOutcome::Stack(outcome) = output.outcome.clone() else { panic!("a stack was made") };
    (output, outcome)
}

fn options() -> StackOptions {
    StackOptions::default()
}

fn grey(picture: &Raster) -> Vec<u8> {
    match &picture.samples {
        Samples::Eight(samples) if picture.channels == 1 => samples.clone(),
        _ => panic!("an 8-bit grey picture was expected"),
    }
}

/// Mean squared error of the luma against the truth where `object` is not 0.
fn error(picture: &Raster, object: &[u8]) -> f64 {
    let (ours, truth) = (picture.luma(), stack().truth.sharp.luma());
    let mut sum = (0.0, 0.0);
    for ((a, b), &inside) in ours.data.iter().zip(&truth.data).zip(object) {
        if inside != 0 {
            sum = (sum.0 + f64::from(a - b).powi(2), sum.1 + 1.0);
        }
    }
    sum.0 / sum.1
}

/// Requires every file of a stack with a back light, once; those of a height map only `with_height`.
fn assert_has_every_file(outcome: &StackOutcome, with_height: bool) {
    let of_stack = StackArtifact::ALL.into_iter().filter(|of| with_height || !of.needs_height());
    let mut expected: Vec<&str> = of_stack.map(StackArtifact::name).collect();
    let mut made: Vec<&str> = outcome.artifacts.iter().map(|file| file.name.as_str()).collect();
    expected.sort_unstable();
    made.sort_unstable();
    assert_eq!(made, expected);
}

#[test]
fn a_stack_with_back_light_comes_out_sharp_cut_out_and_measured() {
    let job = TestJob::stack(&both_zip(), options());
    let (output, outcome) = done(&job);
    assert_has_every_file(&outcome, false);
    assert_eq!(
        outcome.image,
        ImageInfo { width: 240, height: 180, bit_depth: 8, crop_offset_px: [0, 0], intrinsics: None }
    );
    assert_eq!(outcome.software.as_deref(), Some(SOFTWARE));
    for artifact in &outcome.artifacts {
        let (_, bytes) = file(&output, &artifact.name);
        assert_eq!(artifact.bytes, bytes.len() as u64);
        assert_eq!(artifact.sha256, hex(&Sha256::digest(&bytes)));
        assert!(artifact.key.starts_with(&format!("results/{}/1/", job.context.job.id)));
    }

    let mask = grey(&picture(&output, "mask").1);
    let truth = &stack().truth;
    let (mut both, mut either) = (0.0, 0.0);
    for (&ours, &theirs) in mask.iter().zip(&truth.mask.data) {
        assert!(ours == 0 || ours == 255);
        both += f64::from(u8::from(ours == 255 && theirs == 255));
        either += f64::from(u8::from(ours == 255 || theirs == 255));
    }
    assert!(both / either > 0.9, "mask IoU is {}", both / either);

    // outside our own mask the picture is black, so only what both call object is compared
    let object: Vec<u8> = mask.iter().zip(&truth.mask.data).map(|(&ours, &theirs)| ours & theirs).collect();
    let (_, image) = picture(&output, "image");
    let fused = error(&image, &object);
    let best = stack().front.iter().map(|slice| error(slice, &object)).fold(f64::MAX, f64::min);
    assert!(fused < 0.8 * best, "fused {fused}, best single slice {best}");

    let Metrics { fusion, slices, mask, timing_ms, .. } = &outcome.metrics;
    assert!(fusion.q_g_top.is_some_and(|q| q > 0.5));
    assert_eq!(slices[2].name, "front/img_2.png");
    assert!(mask.as_ref().is_some_and(|m| m.foreground_fraction > 0.02 && m.foreground_fraction < 0.9));
    assert!(timing_ms.stages.iter().map(|s| s.ms).sum::<u64>() <= timing_ms.total);
}

#[test]
fn the_same_stack_gives_the_same_bytes() {
    let digests = || {
        let job = TestJob::stack(&both_zip(), options());
        let (_, outcome) = done(&job);
        outcome.artifacts.into_iter().map(|a| (a.name, a.sha256)).collect::<Vec<_>>()
    };
    assert_eq!(digests(), digests());
}

#[test]
fn a_stack_without_back_light_is_opaque_wherever_a_slice_covers_it() {
    let job = TestJob::stack(&front_zip(), options());
    let (output, outcome) = done(&job);
    let names: Vec<&str> = outcome.artifacts.iter().map(|a| a.name.as_str()).collect();
    assert_eq!(names, ["image", "preview", "depth"]);
    assert_eq!(outcome.metrics.mask, None);
    let (_, depth) = picture(&output, "depth");
    let Samples::Sixteen(index) = &depth.samples else { panic!("16 bits") };
    assert!(index.iter().all(|&slice| slice < 5), "the reference slice covers the whole canvas");
    let used: std::collections::BTreeSet<u16> = index.iter().copied().collect();
    assert!(used.len() > 2, "several slices are used");
}

#[test]
fn parameters_of_guided_filtering_that_do_not_count_are_named() {
    let warned = |method: Method| {
        let job = TestJob::stack(&front_zip(), StackOptions { method, r1: 20, ..options() });
        done(&job).0.warnings.iter().any(|warning| warning.code == "unused_parameters")
    };
    assert!(warned(Method::HaloCorrected) && warned(Method::Pyramid));
    assert!(!warned(Method::Guided));
}

#[test]
fn a_height_map_comes_with_its_deviations_and_with_what_is_needed_to_read_it() {
    let job = TestJob::stack(&both_zip(), StackOptions { height: HeightMode::Auto, ..options() });
    let (output, outcome) = done(&job);
    assert_has_every_file(&outcome, true);
    let info = outcome.height.expect("a height map was made");
    assert!(info.scale > 0.0 && info.offset < 0.0 && info.median_sigma.is_some(), "{info:?}");
    let sixteen = |name: &str| match picture(&output, name).1.samples {
        Samples::Sixteen(samples) => samples,
        Samples::Eight(_) => panic!("{name} has 16 bits"),
    };
    let (heights, sigmas) = (sixteen("height"), sixteen("height-sigma"));
    assert!(heights.iter().zip(&sigmas).all(|(&height, &sigma)| (height == 0) == (sigma == 0)));
    let Samples::Eight(mask) = picture(&output, "mask").1.samples else { panic!("8 bits") };
    assert!(heights.iter().zip(&mask).all(|(&height, &mask)| height == 0 || mask == 255));
    assert!(heights.iter().any(|&height| height != 0));
}

#[test]
fn mask_none_does_not_look_at_the_back_light() {
    let job = TestJob::stack(&both_zip(), StackOptions { mask: MaskMode::None, ..options() });
    let (_, outcome) = done(&job);
    assert!(outcome.artifacts.iter().all(|a| a.name != "mask" && a.name != "backlight"));
}

#[test]
fn a_required_mask_that_cannot_be_made_fails_the_job() {
    let required = StackOptions { mask: MaskMode::Required, ..options() };
    let hopeless = StackOptions { mask_threshold: MaskThreshold::Fixed(0.0), ..required.clone() };
    for job in [TestJob::stack(&front_zip(), required), TestJob::stack(&both_zip(), hopeless)] {
        let Err(JobError::Failed(fault)) = run_with(&job, &Recorder::default()) else { panic!("must fail") };
        assert_eq!(fault.code, Code::MaskFailed);
        assert!(fault.detail.contains("mask=required"), "{}", fault.detail);
    }
}

#[test]
fn a_black_and_a_white_back_light_are_named_as_such() {
    let of = |level: u8| {
        let pictures = |folder: &str, slices: &[Raster]| -> Vec<(String, Vec<u8>)> {
            (0..).zip(slices).map(|(i, slice)| (format!("{folder}/img_{i}.png"), png(slice))).collect()
        };
        let plain: Vec<Raster> = stack()
            .back
            .iter()
            .map(|slice| Raster::eight(slice.width, slice.height, 3, vec![level; slice.width * slice.height * 3]))
            .collect();
        let mut members = pictures("front", &stack().front);
        members.extend(pictures("back", &plain));
        zip(members)
    };
    for (level, code, says) in [(0, "mask_full", "the mask is full"), (255, "mask_empty", "the mask is empty")] {
        let (output, _) = done(&TestJob::stack(&of(level), options()));
        let told: Vec<&str> = output.warnings.iter().filter(|w| w.code == code).map(|w| w.detail.as_str()).collect();
        assert!(told.len() == 1 && told[0].contains(says), "{code}: {:?}", output.warnings);
        let required = TestJob::stack(&of(level), StackOptions { mask: MaskMode::Required, ..options() });
        let Err(JobError::Failed(fault)) = run_with(&required, &Recorder::default()) else { panic!("must fail") };
        assert!(fault.code == Code::MaskFailed && fault.detail.contains(says), "{}", fault.detail);
    }
}

#[test]
fn progress_runs_from_start_to_end_and_never_back() {
    let job = TestJob::stack(&both_zip(), options());
    let recorder = Recorder::default();
    run_with(&job, &recorder).expect("the job");
    let reports = recorder.reports.into_inner().unwrap();
    assert!(reports.windows(2).all(|pair| pair[0].fraction <= pair[1].fraction));
    assert_eq!((reports[0].fraction, reports.last().unwrap().fraction), (0.0, 1.0));
    let widest = reports.windows(2).map(|pair| pair[1].fraction - pair[0].fraction).fold(0.0, f64::max);
    assert!(widest < 0.3, "the largest jump is {widest}");
    let mut stages: Vec<&str> = reports.iter().map(|progress| progress.stage.as_str()).collect();
    stages.dedup();
    assert_eq!(
        stages,
        ["reading", "aligning", "fusing", "masking", "aligning", "fusing", "correcting halos", "writing"]
    );
}

#[test]
fn a_job_that_is_not_wanted_stops_wherever_it_is() {
    for stop_at in [0.0, 0.1, 0.4, 0.6, 0.93] {
        let job = TestJob::stack(&both_zip(), options());
        let recorder = Recorder { stop_at: Some(stop_at), ..Recorder::default() };
        let result = run_with(&job, &recorder);
        assert!(matches!(result, Err(JobError::Cancelled(_))), "at {stop_at}");
    }
}

#[test]
fn a_torn_slice_fails_the_job_and_is_named() {
    let mut members: Vec<(String, Vec<u8>)> = stack()
        .front
        .iter()
        .enumerate()
        .map(|(i, slice)| (format!("img_{i}.png"), crate::jobs::testkit::png(slice)))
        .collect();
    let half = members[3].1.len() / 2;
    members[3].1.truncate(half);
    let job = TestJob::stack(&zip(members), options());
    let Err(JobError::Failed(fault)) = run_with(&job, &Recorder::default()) else { panic!("must fail") };
    assert_eq!(fault.code, Code::InvalidImage);
    assert!(fault.detail.contains("img_3.png"), "{}", fault.detail);
}
