//! Fusion as a whole: on truth, by property, and against its definition.

mod halo_corrected;
mod oracle;
mod pyramid;
pub(super) mod rendered;
mod robust;
mod silhouette;

use std::sync::{
    Mutex,
    atomic::{AtomicUsize, Ordering},
};

use super::{
    run::{locked, unlocked},
    *,
};
use crate::{
    imaging::{Plane, Samples},
    types::{
        Cancelled, Homography, NoControl,
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

/// A picture in colour, 0..1: texture in one of `slices` vertical strips, faint everywhere else.
fn stripe(width: usize, height: usize, slices: usize, slice: usize) -> Vec<f64> {
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

fn stripes(width: usize, height: usize, slices: usize) -> Vec<Raster> {
    (0..slices).map(|slice| eight(width, height, &stripe(width, height, slices, slice))).collect()
}

/// A stack whose slices must be moved, turned and brightened, and leave parts of the canvas uncovered.
fn moved(width: usize, height: usize, slices: usize) -> (Vec<Raster>, Plan) {
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
    (stripes(width, height, slices), plan)
}

fn fused(slices: &[Raster], plan: &Plan) -> Fused {
    fuse(&slices, plan, &MetricsRequest::default(), &std::env::temp_dir(), &NoControl).unwrap()
}

fn fused_in_tiles(slices: &[Raster], plan: &Plan, tile: usize) -> Fused {
    let (request, folder) = (MetricsRequest::default(), std::env::temp_dir());
    let slices = FormattedSlices::open(&slices, plan.width, plan.height).unwrap();
    Run { slices, plan, request: &request, scratch_dir: &folder, control: &NoControl, tile }.fuse().unwrap()
}

fn values(raster: &Raster) -> Vec<f64> {
    match &raster.samples {
        Samples::Eight(samples) => samples.iter().map(|&v| f64::from(v)).collect(),
        Samples::Sixteen(samples) => samples.iter().map(|&v| f64::from(v)).collect(),
    }
}

#[test]
fn each_strip_comes_from_the_slice_that_shows_it_sharp() {
    let (width, height, count) = (180, 90, 3);
    let slices = stripes(width, height, count);
    let result = fused(&slices, &Plan::aligned(width, height, count));
    let (picture, mut worst) = (values(&result.image), 0.0f64);
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
                worst = worst.max((picture[at] - sources[truth][at]).abs());
            }
        }
    }
    assert!(worst <= 12.0, "{worst} levels from the sharp slice");
}

#[test]
fn a_stack_of_one_slice_over_and_over_comes_back_bit_by_bit() {
    let one = eight(70, 60, &stripe(70, 60, 2, 0));
    let result = fused(&[one.clone(), one.clone(), one.clone()], &Plan::aligned(70, 60, 3));
    assert_eq!(result.image, one);
    assert!(result.index.data.iter().all(|&slice| slice == 0 || slice == 1));
    assert!(result.valid.data.iter().all(|&v| v == 255));
    assert_eq!(result.warnings, []);
}

#[test]
fn where_nothing_is_sharp_the_reference_slice_is_chosen() {
    let flat = |value: u8| Raster::eight(40, 30, 1, vec![value; 40 * 30]);
    let result = fused(&[flat(90), flat(120), flat(200)], &Plan::aligned(40, 30, 3));
    assert!(result.index.data.iter().all(|&slice| slice == 1));
    assert_eq!(result.image, flat(120));
}

#[test]
fn a_single_slice_is_its_own_fusion() {
    let (slices, plan) = (stripes(50, 40, 1), Plan::aligned(50, 40, 1));
    assert_eq!(fused(&slices, &plan).image, slices[0]);
}

#[test]
fn the_result_is_the_definition_computed_on_whole_planes_in_double_precision() {
    let (slices, plan) = moved(90, 60, 3);
    oracle::assert_agrees(&slices, &plan, 1.0);
    let (slices, mut plan) = moved(70, 80, 2);
    plan.params = GuidedParams { r1: 20, eps1: 0.1, r2: 4, eps2: 1e-4, average: 15, r_g: 3, sigma_g: 2.0 };
    oracle::assert_agrees(&slices, &plan, 1.0);
}

#[test]
fn sixteen_bits_and_grey_follow_the_definition_too() {
    let (_, plan) = moved(60, 50, 3);
    let deep: Vec<Raster> = (0..3).map(|slice| sixteen(60, 50, &stripe(60, 50, 3, slice))).collect();
    oracle::assert_agrees(&deep, &plan, 6.0);
    let grey: Vec<Raster> = deep
        .iter()
        .map(|raster| Raster::eight(60, 50, 1, values(raster).chunks(3).map(|p| (p[1] / 257.0) as u8).collect()))
        .collect();
    oracle::assert_agrees(&grey, &plan, 1.0);
}

#[test]
fn the_size_of_the_tiles_does_not_change_a_bit() {
    let (slices, mut plan) = moved(170, 140, 4);
    plan.params.r1 = 12;
    let whole = fused_in_tiles(&slices, &plan, 1000);
    for tile in [33, 64, 100] {
        assert_eq!(fused_in_tiles(&slices, &plan, tile), whole);
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let (slices, plan) = moved(150, 200, 5);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fused_in_tiles(&slices, &plan, 64))
    };
    let one = with(1);
    assert_eq!(with(2), one);
    assert_eq!(with(4), one);
}

#[test]
fn what_no_slice_covers_is_uncovered_black_and_told() {
    let slices = stripes(90, 60, 2);
    let mut plan = Plan::aligned(90, 60, 2);
    plan.slices[0].homography = Homography::similarity(1.0, [7.0, 0.0]);
    plan.slices[1].homography = Homography::similarity(1.0, [9.0, 0.0]);
    let result = fused(&slices, &plan);
    let picture = values(&result.image);
    for y in 0..60 {
        for x in 0..90 {
            let covered = x >= 7;
            assert_eq!(result.valid.at(x, y) == 255, covered);
            assert_eq!(result.index.at(x, y) == UNCOVERED, !covered);
            assert_eq!(picture[(y * 90 + x) * 3..][..3].iter().any(|&v| v > 0.0), covered);
        }
    }
    assert_eq!(result.warnings.iter().map(|w| w.code.as_str()).collect::<Vec<_>>(), ["canvas_not_covered"]);
}

#[test]
fn a_pixel_that_the_sharp_slice_does_not_cover_comes_from_another() {
    let (width, height) = (120, 80);
    let sharp = eight(width, height, &stripe(width, height, 1, 0));
    let faint = eight(width, height, &stripe(width, height, 1, 1));
    let mut plan = Plan::aligned(width, height, 2);
    plan.slices[0].homography = Homography::similarity(1.0, [40.0, 0.0]);
    let result = fused(&[sharp, faint.clone()], &plan);
    let (picture, other) = (values(&result.image), values(&faint));
    for y in 0..height {
        assert!(result.index.row(y)[..46].iter().all(|&slice| slice == 1), "row {y}");
        assert!(result.index.row(y)[46..].iter().all(|&slice| slice == 0), "row {y}");
        // not covered by the sharp slice: nothing of it may be seen, however wide the filters are
        let row = y * width * 3..(y * width + 40) * 3;
        assert_eq!(picture[row.clone()], other[row]);
    }
}

#[test]
fn a_slice_of_another_size_is_refused_by_name() {
    let slices = [stripes(60, 40, 1)[0].clone(), stripes(60, 41, 1)[0].clone()];
    let stop =
        fuse(&&slices[..], &Plan::aligned(60, 40, 2), &MetricsRequest::default(), &std::env::temp_dir(), &NoControl);
    let Err(Interrupted::Failed(fault)) = stop else { panic!("{stop:?}") };
    assert_eq!(fault.kind, ErrorKind::SizeMismatch);
    assert_eq!(fault.locations[0].slice, Some(1));
    assert!(fault.detail.contains("60 x 41"), "{}", fault.detail);
}

#[test]
fn a_profile_of_another_length_is_refused() {
    let slices = stripes(60, 40, 2);
    let stop =
        fuse(&&slices[..], &Plan::aligned(60, 40, 3), &MetricsRequest::default(), &std::env::temp_dir(), &NoControl);
    assert!(matches!(stop, Err(Interrupted::Failed(Error { kind: ErrorKind::SliceCountMismatch, .. }))));
}

#[test]
fn grey_slices_among_coloured_ones_are_taken_and_the_other_way_round_is_refused() {
    let colour = stripes(60, 40, 1)[0].clone();
    let grey = Raster::eight(60, 40, 1, values(&colour).chunks(3).map(|p| p[0] as u8).collect());
    let mixed = fused(&[colour.clone(), grey.clone()], &Plan::aligned(60, 40, 2));
    assert_eq!(mixed.image.channels, 3);
    let stop = fuse(
        &&[grey, colour][..],
        &Plan::aligned(60, 40, 2),
        &MetricsRequest::default(),
        &std::env::temp_dir(),
        &NoControl,
    );
    let Err(Interrupted::Failed(fault)) = stop else { panic!("{stop:?}") };
    assert_eq!((fault.kind, fault.locations[0].slice), (ErrorKind::InvalidImage, Some(1)));
}

/// Says stop after some questions, and notes the progress.
struct Impatient {
    patience: usize,
    asked: AtomicUsize,
    steps: Mutex<Vec<(&'static str, usize, usize)>>,
}

impl Impatient {
    fn new(patience: usize) -> Self {
        Self { patience, asked: AtomicUsize::new(0), steps: Mutex::new(Vec::new()) }
    }
}

impl Control for Impatient {
    fn progress(&self, stage: &'static str, completed: usize, total: usize) {
        locked(&self.steps).push((stage, completed, total));
    }

    fn check(&self) -> Result<(), Cancelled> {
        if self.asked.fetch_add(1, Ordering::Relaxed) < self.patience { Ok(()) } else { Err(Cancelled) }
    }
}

#[test]
fn work_that_is_cancelled_stops_at_any_point() {
    let (slices, plan) = moved(120, 90, 3);
    let patient = Impatient::new(usize::MAX);
    let done =
        |control: &Impatient| fuse(&&slices[..], &plan, &MetricsRequest::default(), &std::env::temp_dir(), control);
    assert!(done(&patient).is_ok());
    let questions = patient.asked.load(Ordering::Relaxed);
    assert!(questions > 10, "only {questions} questions");
    for patience in (0..questions).step_by(3) {
        assert!(matches!(done(&Impatient::new(patience)), Err(Interrupted::Cancelled(_))));
    }
}

#[test]
fn progress_grows_to_the_end_of_each_stage() {
    let (slices, plan) = moved(120, 90, 4);
    let control = Impatient::new(usize::MAX);
    fuse(&&slices[..], &plan, &MetricsRequest::default(), &std::env::temp_dir(), &control).unwrap();
    let steps = unlocked(control.steps);
    let aligning: Vec<_> = steps.iter().filter(|step| step.0 == "aligning").map(|step| step.1).collect();
    assert_eq!(aligning, [0, 1, 2, 3, 4]);
    let last = steps.last().unwrap();
    assert_eq!((last.0, last.1), ("fusing", last.2));
    assert!(steps.windows(2).all(|pair| pair[0].0 != pair[1].0 || pair[0].1 < pair[1].1));
}

#[test]
fn metrics_are_measured_on_request_and_do_not_depend_on_the_number_of_threads() {
    let (slices, plan) = moved(600, 140, 3);
    let object = Plane::from_fn(600, 140, |x, _| if x < 300 { 255u8 } else { 0 });
    let measured = |threads: usize, object: Option<&Plane<u8>>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let request = MetricsRequest { enabled: true, object };
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
    // the slice whose strip is not in the object adds nothing to it
    assert!(of_object.slices[2].contribution.unwrap() < 0.05, "{:?}", of_object.slices[2]);
}

#[test]
fn a_mask_of_another_size_is_refused() {
    let slices = stripes(60, 40, 2);
    let object = Plane::filled(61, 40, 255u8);
    let request = MetricsRequest { enabled: true, object: Some(&object) };
    let stop = fuse(&&slices[..], &Plan::aligned(60, 40, 2), &request, &std::env::temp_dir(), &NoControl);
    assert!(matches!(stop, Err(Interrupted::Failed(_))));
}

#[test]
fn a_scratch_folder_that_is_not_there_is_told() {
    let slices = stripes(60, 40, 2);
    let nowhere = Path::new("/nowhere/at/all");
    let stop = fuse(&&slices[..], &Plan::aligned(60, 40, 2), &MetricsRequest::default(), nowhere, &NoControl);
    let Err(Interrupted::Failed(fault)) = stop else { panic!("{stop:?}") };
    assert!(fault.detail.contains("scratch file"), "{}", fault.detail);
}

#[test]
fn extreme_pictures_give_no_nan_and_stay_in_range() {
    let (width, height) = (80, 60);
    let checker = |odd: usize| {
        let at = |i: usize| if (i / width + i % width) % 2 == odd { 65_535u16 } else { 0 };
        Raster::sixteen(width, height, 1, (0..width * height).map(at).collect())
    };
    let mut plan = Plan::aligned(width, height, 2);
    plan.params.eps1 = 1e-9;
    plan.params.eps2 = 1e-9;
    let result = fused(&[checker(0), checker(1)], &plan);
    // equal saliency everywhere: the first slice
    assert_eq!(result.image, checker(0));
    let black_and_white = [Raster::eight(9, 3, 1, vec![0; 27]), Raster::eight(9, 3, 1, vec![255; 27])];
    assert_eq!(fused(&black_and_white, &Plan::aligned(9, 3, 2)).image, black_and_white[1]);
}
