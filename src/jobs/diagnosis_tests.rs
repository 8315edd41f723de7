//! Stacks that would come out wrong without a word, through the whole job.

use std::path::Path;

use super::*;
use crate::{
    contract::{
        input::{InputBits, SliceOrder},
        options::StackOptions,
        request::JobRequest,
    },
    jobs::{
        Made,
        stack::run,
        testkit::{Laid, Recorder, both_zip, file, front_zip, png, stack, target_zip, zip},
    },
};
use pinstack_science::{
    archive::ArchiveLimits,
    imaging::{Samples, codec},
    types::{NoControl, fusion_options::Method},
};

fn outcome(archive: &[u8], options: StackOptions) -> Result<Made, JobError> {
    let laid = Laid::stack(archive, options);
    let JobRequest::Stack(request) = &laid.bench.job.request else { panic!("a stack") };
    let made = run(&laid.bench, request, &ArchiveLimits::default(), &Recorder::default())?;
    // the pictures outlive the bench
    Ok(made)
}

/// Codes of the warnings of a stack.
fn warned(archive: &[u8], options: StackOptions) -> Vec<String> {
    let made = outcome(archive, options).expect("the job");
    made.warnings.into_iter().map(|warning| warning.code).collect()
}

/// The image of a stack, its bytes, and what was warned of.
fn image(archive: &[u8], options: StackOptions) -> (Vec<u8>, Vec<Warning>) {
    let laid = Laid::stack(archive, options);
    let JobRequest::Stack(request) = &laid.bench.job.request else { panic!("a stack") };
    let made = run(&laid.bench, request, &ArchiveLimits::default(), &Recorder::default()).expect("the job");
    (file(&made, "image").1, made.warnings)
}

fn members<'a>(folder: &str, slices: impl Iterator<Item = &'a Raster>) -> Vec<(String, Vec<u8>)> {
    slices.enumerate().map(|(i, slice)| (format!("{folder}/img_{i}.png"), png(slice))).collect()
}

/// The slices with 12 bits in files of 16.
fn twelve_bits(slices: &[Raster]) -> Vec<Raster> {
    let of = |slice: &Raster| {
        let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
        let samples = samples.iter().map(|&v| u16::from(v) * 16).collect();
        Raster::sixteen(slice.width, slice.height, slice.channels, samples)
    };
    slices.iter().map(of).collect()
}

/// What these diagnoses say; other warnings are of no interest here.
const DIAGNOSES: [&str; 4] = ["lights_exchanged", "dot_target", "unused_input_bits", "slices_reversed"];

#[test]
fn a_stack_without_fault_hears_nothing_of_this() {
    for method in [Method::Guided, Method::Pyramid, Method::HaloCorrected] {
        for archive in [front_zip(), both_zip()] {
            let warned = warned(&archive, StackOptions { method, ..StackOptions::default() });
            assert!(DIAGNOSES.iter().all(|code| !warned.iter().any(|told| told == code)), "{method:?}: {warned:?}");
        }
    }
}

#[test]
fn slices_in_reverse_are_named_and_put_right_on_demand() {
    let mut all = members("front", stack().front.iter().rev());
    all.extend(members("back", stack().back.iter().rev()));
    let reversed = zip(all);
    let (_, told) = image(&reversed, StackOptions::default());
    let found = told.iter().find(|warning| warning.code == "slices_reversed").unwrap_or_else(|| panic!("{told:?}"));
    assert!(found.detail.contains("order=reverse"), "{}", found.detail);
    assert!(!told.iter().any(|warning| warning.detail.contains("calibrate again")), "{told:?}");

    let (right, told) = image(&reversed, StackOptions { order: SliceOrder::Reverse, ..StackOptions::default() });
    assert!(!told.iter().any(|warning| DIAGNOSES.contains(&warning.code.as_str())), "{told:?}");
    assert!(right == image(&both_zip(), StackOptions::default()).0, "the same picture as of the slices in order");
}

#[test]
fn exchanged_lights_are_named_and_no_mask_is_made_of_them_where_one_is_required() {
    let mut all = members("back", stack().front.iter());
    all.extend(members("front", stack().back.iter()));
    let exchanged = zip(all);
    for method in [Method::Guided, Method::HaloCorrected] {
        let warned = warned(&exchanged, StackOptions { method, ..StackOptions::default() });
        assert!(warned.iter().any(|code| code == "lights_exchanged"), "{warned:?}");
        assert!(!warned.iter().any(|code| OF_A_WRONG_LIGHT.contains(&code.as_str())), "{warned:?}");
    }
    let required = StackOptions { mask: MaskMode::Required, ..StackOptions::default() };
    let Err(JobError::Failed(fault)) = outcome(&exchanged, required.clone()) else { panic!("must fail") };
    assert!(fault.code == Code::MaskFailed && fault.detail.contains("exchanged"), "{}", fault.detail);
    assert!(outcome(&both_zip(), required).is_ok());
}

#[test]
fn a_dot_target_is_named() {
    let warned = warned(&target_zip(), StackOptions::default());
    assert!(warned.iter().any(|code| code == "dot_target"), "{warned:?}");
}

#[test]
fn twelve_bits_in_files_of_sixteen_are_named_and_stretched_on_demand() {
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
        let luma = codec::decode(bytes, &codec::Limits::default()).expect("a picture").luma();
        luma.data.iter().map(|&v| f64::from(v)).sum::<f64>() / luma.data.len() as f64
    };
    let (ours, right) = (mean(&stretched), mean(&image(&both_zip(), StackOptions::default()).0));
    assert!((ours / right - 1.0).abs() < 0.03, "mean {ours} instead of {right}");

    let fewer = StackOptions { input_bits: InputBits::Ten, ..StackOptions::default() };
    let Err(JobError::Failed(fault)) = outcome(&dark, fewer) else { panic!("must fail") };
    assert_eq!(fault.code, Code::InvalidImage);
    let ordinary = StackOptions { input_bits: InputBits::Sixteen, ..StackOptions::default() };
    assert!(!warned(&dark, ordinary).iter().any(|code| code == "unused_input_bits"));
}

/// Real stacks that lie beside the repository; nothing is tested where they are missing.
#[test]
fn real_pictures_are_told_apart() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let picture = |path: &Path| {
        let bytes = std::fs::read(path).ok()?;
        codec::decode(&bytes, &codec::Limits::default()).ok()
    };
    let mut folders: Vec<_> = std::fs::read_dir(&data).into_iter().flatten().flatten().map(|e| e.path()).collect();
    folders.sort();
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
            !pinstack_science::segmentation::exchanged(&front, &back)
                && pinstack_science::segmentation::exchanged(&back, &front)
        );
    }
    if let Some(target) = picture(&data.join("turntable_stack/calib/calib_f004.png")) {
        assert!(calibration::dot_target(&target, &NoControl).expect("not cancelled").is_some());
    }
}
