//! Stacks that would silently give wrong results, run through the whole job.

use std::path::{Path, PathBuf};

use super::*;
use crate::{
    contract::{
        input::{InputBits, SliceOrder},
        options::StackOptions,
        request::JobRequest,
    },
    jobs::{
        JobOutput,
        stack::run,
        testkit::{Recorder, TestJob, both_zip, file, front_zip, pixels, png, stack, target_zip, zip},
    },
};
use pinstack_science::{
    archive::ArchiveLimits,
    imaging::{Samples, codec},
    types::{NoControl, fusion_options::Method},
};

fn outcome(archive: &[u8], options: StackOptions) -> Result<JobOutput, JobError> {
    let job = TestJob::stack(archive, options);
    let JobRequest::Stack(request) = &job.context.job.request else { panic!("a stack") };
    let output = run(&job.context, request, &ArchiveLimits::default(), &Recorder::default())?;
    // the warnings outlive the test job
    Ok(output)
}

/// Codes of the warnings of a stack.
fn warned(archive: &[u8], options: StackOptions) -> Vec<WarningCode> {
    let output = outcome(archive, options).expect("the job");
    output.warnings.into_iter().map(|warning| warning.code).collect()
}

/// The bytes of the image of a stack, and its warnings.
fn image(archive: &[u8], options: StackOptions) -> (Vec<u8>, Vec<Warning>) {
    let job = TestJob::stack(archive, options);
    let JobRequest::Stack(request) = &job.context.job.request else { panic!("a stack") };
    let output = run(&job.context, request, &ArchiveLimits::default(), &Recorder::default()).expect("the job");
    (file(&output, "image").1, output.warnings)
}

fn members<'a>(folder: &str, slices: impl Iterator<Item = &'a Raster>) -> Vec<(String, Vec<u8>)> {
    slices.enumerate().map(|(i, slice)| (format!("{folder}/img_{i}.png"), png(slice))).collect()
}

/// The slices with 12 bits of data in 16-bit samples.
fn twelve_bits(slices: &[Raster]) -> Vec<Raster> {
    let of = |slice: &Raster| {
        let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
        let samples = samples.iter().map(|&v| u16::from(v) * 16).collect();
        Raster::sixteen(slice.width, slice.height, slice.channels, samples)
    };
    slices.iter().map(of).collect()
}

/// The codes of these diagnoses; other warnings are ignored here.
const DIAGNOSES: [WarningCode; 4] =
    [WarningCode::LightsExchanged, WarningCode::DotTarget, WarningCode::UnusedInputBits, WarningCode::SlicesReversed];

#[test]
fn a_sound_stack_gets_none_of_these_warnings() {
    for method in Method::ALL {
        for archive in [front_zip(), both_zip()] {
            let warned = warned(&archive, StackOptions { method, ..StackOptions::default() });
            assert!(DIAGNOSES.iter().all(|code| !warned.contains(code)), "{method:?}: {warned:?}");
        }
    }
}

#[test]
fn reversed_slices_are_warned_of_and_corrected_on_request() {
    let mut all = members("front", stack().front.iter().rev());
    all.extend(members("back", stack().back.iter().rev()));
    let reversed = zip(all);
    let (_, told) = image(&reversed, StackOptions::default());
    let found = told.iter().find(|warning| warning.code == "slices_reversed").unwrap_or_else(|| panic!("{told:?}"));
    assert!(found.detail.contains("order=reverse"), "{}", found.detail);
    assert!(!told.iter().any(|warning| warning.detail.contains("calibrate again")), "{told:?}");

    let (right, told) = image(&reversed, StackOptions { order: SliceOrder::Reverse, ..StackOptions::default() });
    assert!(!told.iter().any(|warning| DIAGNOSES.contains(&warning.code)), "{told:?}");
    assert!(right == image(&both_zip(), StackOptions::default()).0, "the same picture as of the slices in order");
}

#[test]
fn exchanged_lights_are_warned_of_and_fail_a_required_mask() {
    let mut all = members("back", stack().front.iter());
    all.extend(members("front", stack().back.iter()));
    let exchanged = zip(all);
    for method in [Method::Guided, Method::HaloCorrected] {
        let warned = warned(&exchanged, StackOptions { method, ..StackOptions::default() });
        assert!(warned.contains(&WarningCode::LightsExchanged), "{warned:?}");
        assert!(!warned.iter().any(|code| CAUSED_BY_EXCHANGED_LIGHTS.contains(code)), "{warned:?}");
    }
    let required = StackOptions { mask: MaskMode::Required, ..StackOptions::default() };
    let Err(JobError::Failed(fault)) = outcome(&exchanged, required.clone()) else { panic!("must fail") };
    assert!(fault.code == Code::MaskFailed && fault.detail.contains("exchanged"), "{}", fault.detail);
    assert!(outcome(&both_zip(), required).is_ok());
}

#[test]
fn a_dot_target_is_warned_of() {
    let warned = warned(&target_zip(), StackOptions::default());
    assert!(warned.contains(&WarningCode::DotTarget), "{warned:?}");
}

#[test]
fn twelve_bits_in_16_bit_files_are_warned_of_and_scaled_on_request() {
    let mut all = members("front", twelve_bits(&stack().front).iter());
    all.extend(members("back", twelve_bits(&stack().back).iter()));
    let dark = zip(all);
    let (_, told) = image(&dark, StackOptions::default());
    let found = told.iter().find(|warning| warning.code == "unused_input_bits").unwrap_or_else(|| panic!("{told:?}"));
    assert!(found.detail.contains("of 65535") && found.detail.contains("input_bits=12"), "{}", found.detail);

    let twelve = StackOptions { input_bits: InputBits::Twelve, ..StackOptions::default() };
    let (stretched, told) = image(&dark, twelve);
    assert!(!told.iter().any(|warning| warning.code == "unused_input_bits"), "{told:?}");
    let mean = |bytes: &[u8]| {
        let luma = pixels(bytes).luma();
        luma.data.iter().map(|&v| f64::from(v)).sum::<f64>() / luma.data.len() as f64
    };
    let (ours, right) = (mean(&stretched), mean(&image(&both_zip(), StackOptions::default()).0));
    assert!((ours / right - 1.0).abs() < 0.03, "mean {ours} instead of {right}");

    let fewer = StackOptions { input_bits: InputBits::Ten, ..StackOptions::default() };
    let Err(JobError::Failed(fault)) = outcome(&dark, fewer) else { panic!("must fail") };
    assert_eq!(fault.code, Code::InvalidImage);
    let ordinary = StackOptions { input_bits: InputBits::Sixteen, ..StackOptions::default() };
    assert!(!warned(&dark, ordinary).contains(&WarningCode::UnusedInputBits));
}

#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn real_pictures_are_diagnosed() {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let data = std::env::var_os("PINSTACK_SHARED").map_or_else(beside, PathBuf::from).join("data");
    let picture = |path: &Path| {
        let bytes = std::fs::read(path).ok()?;
        codec::decode(&bytes, &codec::Limits::default()).ok()
    };
    let mut folders: Vec<_> = std::fs::read_dir(&data).into_iter().flatten().flatten().map(|e| e.path()).collect();
    folders.sort();
    assert!(folders.len() >= 5, "the stacks are missing from {}", data.display());
    for folder in folders {
        let mut files: Vec<_> = std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
        files.sort();
        let Some(object) = files.get(files.len() / 2).and_then(|path| picture(path)) else { continue };
        let dots = calibration::dot_target(&object, &NoControl).expect("not cancelled");
        assert_eq!(dots, None, "{}", folder.display());
    }
    let view = data.join("turntable_stack/view_p000.00_t00.00");
    let front = picture(&view.join("f004.jpg")).or_else(|| picture(&view.join("front/f004.jpg")));
    if let (Some(front), Some(back)) = (front, picture(&view.join("back/f004.jpg"))) {
        assert!(
            !pinstack_science::segmentation::lights_exchanged(&front, &back)
                && pinstack_science::segmentation::lights_exchanged(&back, &front)
        );
    }
    if let Some(target) = picture(&data.join("turntable_stack/calib/calib_f004.png")) {
        assert!(calibration::dot_target(&target, &NoControl).expect("not cancelled").is_some());
    }
}
