//! Tests of fusion as a whole: against images with known truth, by property, and against the definition of the method.

mod control;
mod fidelity;
mod flicker;
mod focus_range;
mod further_light;
mod halo_corrected;
mod near_detail;
mod oracle;
mod outlines;
mod published;
mod pyramid;
pub(super) mod rendered;
mod robust;
mod shown;
mod silhouette;
mod wide_blur;

use super::*;
use crate::{
    imaging::{Plane, Samples},
    types::{
        Homography, NoControl,
        fusion_options::{GuidedParams, Method},
    },
};

/// Deterministic noise, 0..1.
fn noise(x: usize, y: usize, seed: usize) -> f64 {
    let mut v = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ (seed as u64).wrapping_mul(0x1656_67B1_9E37_79F9);
    v ^= v >> 29;
    v = v.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    v ^= v >> 32;
    (v % 10_007) as f64 / 10_007.0
}

/// An RGB image, 0..1, with strong texture in strip `slice` of `slices` vertical strips and faint texture in the
/// others.
fn strip(width: usize, height: usize, slices: usize, slice: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            let sharp = x * slices / width == slice;
            for c in 0..3 {
                let smooth = 0.5 + 0.2 * ((x as f64) * 0.05 + c as f64).sin() + 0.1 * ((y as f64) * 0.07).cos();
                let texture = noise(x, y, c) - 0.5;
                out.push(smooth + texture * if sharp { 0.35 } else { 0.03 + 0.002 * slice as f64 });
            }
        }
    }
    out
}

fn eight(width: usize, height: usize, values: &[f64]) -> Raster {
    Raster::eight(width, height, 3, values.iter().map(|v| (v * 255.0).round() as u8).collect())
}

fn sixteen(width: usize, height: usize, values: &[f64]) -> Raster {
    Raster::sixteen(width, height, 3, values.iter().map(|v| (v * 65_535.0).round() as u16).collect())
}

/// A stack in which slice `i` is sharp in strip `i`.
fn strips(width: usize, height: usize, slices: usize) -> Vec<Raster> {
    (0..slices).map(|slice| eight(width, height, &strip(width, height, slices, slice))).collect()
}

/// A stack whose slices must be shifted, rotated, scaled and brightened, and leave parts of the canvas uncovered.
fn unaligned(width: usize, height: usize, slices: usize) -> (Vec<Raster>, Plan) {
    let mut plan = Plan::aligned(width, height, slices);
    for slice in 0..slices {
        let away = slice as f64 - plan.reference as f64;
        let homography = Homography([
            1.0 - 0.02 * away,
            0.01 * away,
            3.3 * away,
            -0.008 * away,
            1.0 - 0.02 * away,
            -2.6 * away,
            0.0,
            0.0,
            1.0,
        ]);
        plan.slices[slice] = SlicePlan { homography, gain: 1.0 + 0.03 * away, rail_mm: None };
    }
    (strips(width, height, slices), plan)
}

fn fused(slices: &[Raster], plan: &Plan) -> Fused {
    fuse(&slices, plan, &FusionRequest::default(), &std::env::temp_dir(), &NoControl).unwrap()
}

fn fused_in_tiles(slices: &[Raster], plan: &Plan, tile: usize) -> Fused {
    fused_as_asked(slices, plan, &FusionRequest::default(), tile)
}

fn fused_as_asked(slices: &[Raster], plan: &Plan, request: &FusionRequest<'_>, tile: usize) -> Fused {
    let folder = std::env::temp_dir();
    let slices = FormattedSlices::open(&slices, plan).unwrap();
    Run { slices, plan, request, scratch_dir: &folder, control: &NoControl, decision_map: None, tile }.fuse().unwrap()
}

fn values(raster: &Raster) -> Vec<f64> {
    match &raster.samples {
        Samples::Eight(samples) => samples.iter().map(|&v| f64::from(v)).collect(),
        Samples::Sixteen(samples) => samples.iter().map(|&v| f64::from(v)).collect(),
    }
}

#[test]
fn each_strip_is_taken_from_the_slice_that_shows_it_sharp() {
    let (width, height, count) = (180, 90, 3);
    let slices = strips(width, height, count);
    let result = fused(&slices, &Plan::aligned(width, height, count));
    let (image, mut worst) = (values(&result.image), 0.0f64);
    let sources: Vec<Vec<f64>> = slices.iter().map(values).collect();
    for y in 0..height {
        for x in 0..width {
            let truth = x * count / width;
            let from_border = (0..count).map(|i| (x as i64 - (i * width / count) as i64).abs()).min().unwrap();
            if from_border < 16 {
                continue;
            }
            assert_eq!(usize::from(result.index.at(x, y)), truth, "at {x}, {y}");
            for c in 0..3 {
                let at = (y * width + x) * 3 + c;
                worst = worst.max((image[at] - sources[truth][at]).abs());
            }
        }
    }
    assert!(worst <= 12.0, "{worst} levels from the sharp slice");
}

#[test]
fn identical_slices_are_returned_unchanged() {
    let one = eight(70, 60, &strip(70, 60, 2, 0));
    let result = fused(&[one.clone(), one.clone(), one.clone()], &Plan::aligned(70, 60, 3));
    assert_eq!(result.image, one);
    assert!(result.index.data.iter().all(|&slice| slice == 0 || slice == 1));
    assert!(result.valid.data.iter().all(|&v| v == 255));
    assert_eq!(result.warnings, []);
}

#[test]
fn where_no_slice_has_detail_the_reference_slice_is_chosen() {
    let flat = |value: u8| Raster::eight(40, 30, 1, vec![value; 40 * 30]);
    let result = fused(&[flat(90), flat(120), flat(200)], &Plan::aligned(40, 30, 3));
    assert!(result.index.data.iter().all(|&slice| slice == 1));
    assert_eq!(result.image, flat(120));
}

#[test]
fn a_single_slice_is_returned_unchanged() {
    let (slices, plan) = (strips(50, 40, 1), Plan::aligned(50, 40, 1));
    assert_eq!(fused(&slices, &plan).image, slices[0]);
}

#[test]
fn the_result_agrees_with_the_definition_in_double_precision() {
    let (slices, plan) = unaligned(90, 60, 3);
    oracle::assert_agrees(&slices, &plan, 1.0);
    let (slices, mut plan) = unaligned(70, 80, 2);
    plan.params = GuidedParams { r1: 20, eps1: 0.1, r2: 4, eps2: 1e-4, average: 15, r_g: 3, sigma_g: 2.0 };
    oracle::assert_agrees(&slices, &plan, 1.0);
}

#[test]
fn results_of_16_bits_and_of_grey_slices_agree_with_the_definition() {
    let (_, plan) = unaligned(60, 50, 3);
    let deep: Vec<Raster> = (0..3).map(|slice| sixteen(60, 50, &strip(60, 50, 3, slice))).collect();
    oracle::assert_agrees(&deep, &plan, 6.0);
    let grey: Vec<Raster> = deep
        .iter()
        .map(|raster| Raster::eight(60, 50, 1, values(raster).chunks(3).map(|p| (p[1] / 257.0) as u8).collect()))
        .collect();
    oracle::assert_agrees(&grey, &plan, 1.0);
}

#[test]
fn the_size_of_the_tiles_does_not_affect_the_result() {
    let (slices, mut plan) = unaligned(170, 140, 4);
    plan.params.r1 = 12;
    let whole = fused_in_tiles(&slices, &plan, 1000);
    for tile in [33, 64, 100] {
        assert_eq!(fused_in_tiles(&slices, &plan, tile), whole);
    }
}

#[test]
fn the_number_of_threads_does_not_affect_the_result() {
    let (slices, plan) = unaligned(150, 200, 5);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fused_in_tiles(&slices, &plan, 64))
    };
    let one = with(1);
    assert_eq!(with(2), one);
    assert_eq!(with(4), one);
}

#[test]
fn pixels_that_no_slice_covers_are_black_and_invalid_with_a_warning() {
    let slices = strips(90, 60, 2);
    let mut plan = Plan::aligned(90, 60, 2);
    plan.slices[0].homography = Homography::similarity(1.0, [7.0, 0.0]);
    plan.slices[1].homography = Homography::similarity(1.0, [9.0, 0.0]);
    let result = fused(&slices, &plan);
    let image = values(&result.image);
    for y in 0..60 {
        for x in 0..90 {
            let covered = x >= 7;
            assert_eq!(result.valid.at(x, y) == 255, covered);
            assert_eq!(result.index.at(x, y) == UNCOVERED, !covered);
            assert_eq!(image[(y * 90 + x) * 3..][..3].iter().any(|&v| v > 0.0), covered);
        }
    }
    assert_eq!(result.warnings.iter().map(|w| w.code.as_str()).collect::<Vec<_>>(), ["canvas_not_covered"]);
}

#[test]
fn where_the_sharp_slice_covers_nothing_another_slice_is_used() {
    let (width, height) = (120, 80);
    let sharp = eight(width, height, &strip(width, height, 1, 0));
    let faint = eight(width, height, &strip(width, height, 1, 1));
    let mut plan = Plan::aligned(width, height, 2);
    plan.slices[0].homography = Homography::similarity(1.0, [40.0, 0.0]);
    let result = fused(&[sharp, faint.clone()], &plan);
    let (image, other) = (values(&result.image), values(&faint));
    for y in 0..height {
        assert!(result.index.row(y)[..46].iter().all(|&slice| slice == 1), "row {y}");
        assert!(result.index.row(y)[46..].iter().all(|&slice| slice == 0), "row {y}");
        // the sharp slice does not cover these pixels: it has no effect there, however wide the filters are
        let row = y * width * 3..(y * width + 40) * 3;
        assert_eq!(image[row.clone()], other[row]);
    }
}

#[test]
fn a_slice_of_another_size_is_refused_and_named() {
    let slices = [strips(60, 40, 1)[0].clone(), strips(60, 41, 1)[0].clone()];
    let stop =
        fuse(&&slices[..], &Plan::aligned(60, 40, 2), &FusionRequest::default(), &std::env::temp_dir(), &NoControl);
    let Err(Interrupted::Failed(error)) = stop else { panic!("{stop:?}") };
    assert_eq!(error.kind, ErrorKind::SizeMismatch);
    assert_eq!(error.locations[0].slice, Some(1));
    assert!(error.detail.contains("60 x 41"), "{}", error.detail);
}

#[test]
fn a_profile_for_another_number_of_slices_is_refused() {
    let slices = strips(60, 40, 2);
    let stop =
        fuse(&&slices[..], &Plan::aligned(60, 40, 3), &FusionRequest::default(), &std::env::temp_dir(), &NoControl);
    assert!(matches!(stop, Err(Interrupted::Failed(Error { kind: ErrorKind::SliceCountMismatch, .. }))));
}

#[test]
fn grey_slices_in_a_stack_in_colour_are_accepted_and_the_reverse_is_refused() {
    let colour = strips(60, 40, 1)[0].clone();
    let grey = Raster::eight(60, 40, 1, values(&colour).chunks(3).map(|p| p[0] as u8).collect());
    let mixed = fused(&[colour.clone(), grey.clone()], &Plan::aligned(60, 40, 2));
    assert_eq!(mixed.image.channels, 3);
    let stop = fuse(
        &&[grey, colour][..],
        &Plan::aligned(60, 40, 2),
        &FusionRequest::default(),
        &std::env::temp_dir(),
        &NoControl,
    );
    let Err(Interrupted::Failed(error)) = stop else { panic!("{stop:?}") };
    assert_eq!((error.kind, error.locations[0].slice), (ErrorKind::InvalidImage, Some(1)));
}

#[test]
fn metrics_are_measured_on_request_and_do_not_depend_on_the_number_of_threads() {
    let (slices, plan) = unaligned(600, 140, 3);
    let object = Plane::from_fn(600, 140, |x, _| if x < 300 { 255u8 } else { 0 });
    let measured = |threads: usize, object: Option<&Plane<u8>>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let request = FusionRequest { metrics: true, object, shown: None, decision: false };
        pool.install(|| fuse(&&slices[..], &plan, &request, &std::env::temp_dir(), &NoControl).unwrap())
    };
    let (one, two) = (measured(1, None), measured(3, None));
    assert_eq!(one, two);
    let quality = one.quality.unwrap();
    assert_eq!(quality.slices.len(), 3);
    let q_g = quality.fusion.q_g_top.unwrap();
    assert!((0.5..0.98).contains(&q_g), "{q_g}");
    let of_object = measured(2, Some(&object)).quality.unwrap();
    assert_ne!(of_object.fusion.q_g_top, Some(q_g));
    assert_eq!(fused(&slices, &plan).quality, None);
    // the strip of this slice is not in the object
    assert!(of_object.slices[2].contribution.unwrap() < 0.05, "{:?}", of_object.slices[2]);
}

#[test]
fn a_silhouette_of_another_size_is_refused() {
    let slices = strips(60, 40, 2);
    let object = Plane::filled(61, 40, 255u8);
    let request = FusionRequest { metrics: true, object: Some(&object), shown: None, decision: false };
    let stop = fuse(&&slices[..], &Plan::aligned(60, 40, 2), &request, &std::env::temp_dir(), &NoControl);
    assert!(matches!(stop, Err(Interrupted::Failed(_))));
}

#[test]
fn a_missing_scratch_folder_is_an_error() {
    let slices = strips(60, 40, 2);
    let nowhere = Path::new("/nowhere/at/all");
    let stop = fuse(&&slices[..], &Plan::aligned(60, 40, 2), &FusionRequest::default(), nowhere, &NoControl);
    let Err(Interrupted::Failed(error)) = stop else { panic!("{stop:?}") };
    assert!(error.detail.contains("scratch file"), "{}", error.detail);
}

#[test]
fn extreme_images_give_no_nan_and_stay_in_range() {
    let (width, height) = (80, 60);
    let checker = |odd: usize| {
        let at = |i: usize| if (i / width + i % width) % 2 == odd { 65_535u16 } else { 0 };
        Raster::sixteen(width, height, 1, (0..width * height).map(at).collect())
    };
    let mut plan = Plan::aligned(width, height, 2);
    plan.params.eps1 = 1e-9;
    plan.params.eps2 = 1e-9;
    let result = fused(&[checker(0), checker(1)], &plan);
    // equal saliency everywhere: the first slice is chosen
    assert_eq!(result.image, checker(0));
    let black_and_white = [Raster::eight(9, 3, 1, vec![0; 27]), Raster::eight(9, 3, 1, vec![255; 27])];
    assert_eq!(fused(&black_and_white, &Plan::aligned(9, 3, 2)).image, black_and_white[1]);
}
