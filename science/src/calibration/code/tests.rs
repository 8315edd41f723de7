//! Recognition of the code: from readings, and end to end from rendered stacks.

use super::place::Symmetry;
use super::*;
use crate::calibration::testkit::Noise;
use crate::calibration::{Calibration, calibrate};
use crate::imaging::{Raster, Samples};
use crate::synth::{DotTarget, Rig, render_target, target_stack};
use crate::types::calibration_options::CalibrationOptions;
use crate::types::{Interrupted, NoControl};

/// Readings of a view of `columns` x `rows` dots that lies in the code at `place`.
fn view(place: &CodePlace, columns: i32, rows: i32, wrong: f64, seed: u64) -> Vec<(Label, f64)> {
    let mut noise = Noise(seed);
    let labels = (0..columns * rows).map(|k| [k % columns - 3, k / columns - 2]);
    labels
        .map(|label| {
            let flip = if 0.5 + 0.5 * noise.even() < wrong { -1.0 } else { 1.0 };
            (label, flip * place.size(label).sign() * (0.8 + 0.2 * noise.even()))
        })
        .collect()
}

#[test]
fn a_view_of_sixty_dots_is_found_for_every_symmetry() {
    for (k, symmetry) in Symmetry::all().into_iter().enumerate() {
        let place = CodePlace { symmetry, shift: [250 - 31 * k as i32, 17 + 29 * k as i32] };
        let found = recognise_readings(&view(&place, 10, 6, 0.0, k as u64)).expect("recognised");
        assert_eq!(found.place, place);
        assert!(found.certainty > 10.0, "{}", found.certainty);
    }
}

#[test]
fn a_tenth_of_wrong_readings_does_no_harm_to_a_larger_view() {
    for seed in 0..4 {
        let place = CodePlace { symmetry: Symmetry::all()[seed % 8], shift: [seed as i32, 90] };
        let found = recognise_readings(&view(&place, 14, 10, 0.1, seed as u64)).expect("recognised");
        assert_eq!(found.place, place);
    }
}

#[test]
fn ordinary_grids_are_never_recognised() {
    let mut noise = Noise(5);
    for k in 0..24_i32 {
        let (columns, rows) = (8 + k % 5 * 6, 7 + k % 4 * 5);
        let labels: Vec<Label> = (0..columns * rows).map(|n| [n % columns, n / columns]).collect();
        let readings: Vec<(Label, f64)> = labels
            .iter()
            .copied()
            .filter(|_| noise.even() < 1.0 - 0.02 * f64::from(k % 11))
            .collect::<Vec<_>>()
            .into_iter()
            .map(|label| {
                // noise, alternating rows, or print errors that grow to one side
                let value = match k % 3 {
                    0 => noise.normal(),
                    1 => f64::from(1 - 2 * (label[1] & 1)) + 0.3 * noise.normal(),
                    _ => 0.1 * f64::from(label[0]) * noise.normal(),
                };
                (label, value.clamp(-1.0, 1.0))
            })
            .collect();
        assert_eq!(recognise_readings(&readings), None, "grid {k}");
    }
}

#[test]
fn labels_are_carried_over_between_frames_of_any_orientation() {
    let places: Places = (0..30).map(|k| ([k % 6, k / 6], [f64::from(k), 0.0])).collect();
    let to = CodePlace { symmetry: Symmetry::all()[6], shift: [3, 255] };
    for symmetry in Symmetry::all() {
        let from = CodePlace { symmetry, shift: [250, 7] };
        let moved = relabelled(&places, &from, &to);
        let wrapped = |p: Label| p.map(|v| v.rem_euclid(CODE_PERIOD as i32));
        for (label, at) in &moved {
            let before = places.iter().find(|(_, p)| *p == at).expect("the same dot");
            assert_eq!(wrapped(to.position(*label)), wrapped(from.position(*before.0)));
        }
    }
}

/// A stack of 3 slices with a blur radius of `blur` of the pitch at its ends.
fn rig(blur: f64, columns: usize) -> (Rig, DotTarget) {
    let rig = Rig { channels: 1, noise: 2.0, ..Rig::sized(360, 270, 3) };
    let target = DotTarget { code: Some([101, 37]), ..DotTarget::for_rig(&rig, columns) };
    let now = target.blur_radius_px(&rig, 0) / target.pitch_px(&rig, 0);
    (Rig { f_number: rig.f_number * now / blur, ..rig }, target)
}

fn calibrated(pictures: &[Raster]) -> Calibration {
    calibrate(&pictures, &CalibrationOptions::default(), &NoControl).expect("a calibration")
}

/// Largest distance of a dot of any slice from where its homography should map it; `shown` gives the target of each
/// slice.
fn worst_dot(rig: &Rig, shown: &[DotTarget], calibration: &Calibration) -> f64 {
    let reference = shown[rig.reference].dots(rig, rig.reference);
    let slice = |i: usize| {
        let pairs = shown[i].dots(rig, i).into_iter().zip(&reference);
        let homography = calibration.slices[i].homography;
        pairs
            .map(|(dot, truth)| (homography.apply(dot), truth))
            .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
            .fold(0.0, f64::max)
    };
    (0..shown.len()).map(slice).fold(0.0, f64::max)
}

#[test]
fn a_coded_target_is_recognised_and_measured_as_accurately_as_a_plain_one() {
    let (rig, target) = rig(0.5, 13);
    let calibration = calibrated(&target_stack(&rig, &target));
    let report = calibration.report.target.as_ref().expect("a target");
    assert!(report.coded);
    let code = report.code.as_ref().expect("coded");
    // the outermost dots have no window within the image
    assert!((101..=103).contains(&code.columns[0]) && (110..=113).contains(&code.columns[1]), "{code:?}");
    assert!((37..=39).contains(&code.rows[0]) && !code.mirrored && code.certainty > 15.0, "{code:?}");
    let coded = worst_dot(&rig, &[target.clone(), target.clone(), target.clone()], &calibration);
    assert!(coded < 0.12, "{coded} px");
}

#[test]
fn a_jump_by_more_than_a_pitch_is_a_jump() {
    let (rig, target) = rig(0.3, 22);
    let by = 1.3 * target.pitch_mm;
    let moved = DotTarget { offset_mm: [target.offset_mm[0] + by, target.offset_mm[1]], ..target.clone() };
    let shown = [target.clone(), target, moved];
    let pictures: Vec<Raster> = shown.iter().enumerate().map(|(i, target)| render_target(&rig, target, i)).collect();
    let worst = worst_dot(&rig, &shown, &calibrated(&pictures));
    assert!(worst < 0.2, "{worst} px");
}

fn mirrored(picture: &Raster) -> Raster {
    let Samples::Eight(samples) = &picture.samples else { panic!("rendered with 8 bits") };
    let rows = samples.chunks_exact(picture.width).flat_map(|row| row.iter().rev().copied());
    Raster::eight(picture.width, picture.height, 1, rows.collect())
}

#[test]
fn a_mirrored_slice_is_refused_by_name_and_a_mirrored_stack_is_reported() {
    let (rig, target) = rig(0.2, 13);
    let mut pictures = target_stack(&rig, &target);
    pictures[2] = mirrored(&pictures[2]);
    let Err(Interrupted::Failed(error)) = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl) else {
        panic!("a mirrored slice was accepted")
    };
    assert!(error.to_string().contains("(slice 2) is mirrored against"), "{error}");
    let all: Vec<Raster> = target_stack(&rig, &target).iter().map(mirrored).collect();
    assert_eq!(calibrated(&all).report.target.and_then(|target| target.code).map(|code| code.mirrored), Some(true));
}
