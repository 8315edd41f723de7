//! Jumps and drifts by whole steps, on targets that tell and on those that do not.

use crate::calibration::{Calibration, CalibrationOptions, calibrate};
use crate::imaging::{Raster, Samples};
use crate::synth::{DotTarget, Flaws, Rig, render_target};
use crate::types::report::Grade;
use crate::types::{ErrorKind, Interrupted, NoControl};

fn rig(slices: usize) -> Rig {
    Rig { channels: 1, noise: 1.0, ..Rig::sized(400, 300, slices) }
}

/// A target that extends beyond all borders of the image.
fn endless(rig: &Rig) -> DotTarget {
    DotTarget { columns: 31, rows: 27, ..DotTarget::for_rig(rig, 12) }
}

struct Case {
    calibration: Calibration,
    /// Largest distance of a dot of any slice from where it is in the reference slice, px.
    worst: f64,
}

/// Margin of the rendered images, px: a jump of the rig is another part of a larger image.
const MARGIN: [i32; 2] = [64, 64];

/// The part of a slice that begins at `from`, 400 x 300 px.
fn part(whole: &Raster, from: [i32; 2]) -> Raster {
    let Samples::Eight(samples) = &whole.samples else { panic!("rendered with 8 bits") };
    let rows = samples.chunks_exact(whole.width).skip(from[1] as usize).take(300);
    let data = rows.flat_map(|row| row[from[0] as usize..from[0] as usize + 400].to_vec()).collect();
    Raster::eight(400, 300, 1, data)
}

/// The rig with a margin around its image.
fn wide(rig: &Rig) -> Rig {
    let [width, height] = [rig.width + 2 * MARGIN[0] as usize, rig.height + 2 * MARGIN[1] as usize];
    Rig { width, height, ..rig.clone() }
}

impl Case {
    /// Calibrates on a target that fills 400 x 300 px. Slice `i` shows it `by(i)` pitches further right and down.
    fn new(rig: &Rig, target: &DotTarget, by: impl Fn(usize) -> [f64; 2]) -> Self {
        let wide = wide(rig);
        let pitch = target.pitch_px(&wide, wide.reference);
        let from: Vec<[i32; 2]> =
            (0..rig.slices()).map(|i| [0, 1].map(|a| MARGIN[a] - (by(i)[a] * pitch).round() as i32)).collect();
        let pictures: Vec<Raster> =
            (0..rig.slices()).map(|i| part(&render_target(&wide, target, i), from[i])).collect();
        let calibration = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
        let seen = |i: usize| -> Vec<[f64; 2]> {
            target.dots(&wide, i).iter().map(|d| [0, 1].map(|a| d[a] - f64::from(from[i][a]))).collect()
        };
        let reference = seen(rig.reference);
        let mut worst = 0.0_f64;
        for (i, slice) in calibration.slices.iter().enumerate() {
            for (dot, there) in seen(i).iter().zip(&reference) {
                if (0.0..400.0).contains(&dot[0]) && (0.0..300.0).contains(&dot[1]) {
                    let sent = slice.homography.apply(*dot);
                    worst = worst.max((sent[0] - there[0]).hypot(sent[1] - there[1]));
                }
            }
        }
        println!("{worst:.3} px, {} {:?}", calibration.verdict, calibration.warnings);
        Self { calibration, worst }
    }

    fn is_ambiguous(&self) -> bool {
        self.says("shift_ambiguous")
    }

    fn says(&self, code: &str) -> bool {
        self.calibration.warnings.iter().any(|w| w.code == code)
    }
}

fn jump(from: usize, by: [f64; 2]) -> impl Fn(usize) -> [f64; 2] {
    move |i| if i < from { [0.0; 2] } else { by }
}

fn jumps(by: &[[f64; 2]]) {
    let rig = rig(5);
    let target = DotTarget { columns: 11, rows: 8, ..DotTarget::for_rig(&rig, 14) };
    for &by in by {
        let case = Case::new(&rig, &target, jump(3, by));
        assert!(case.worst < 0.3 && !case.is_ambiguous(), "{by:?}: {}", case.worst);
    }
}

#[test]
fn the_end_of_the_grid_tells_jumps_by_more_than_half_a_step() {
    jumps(&[[-0.3, 0.7]]);
    let rig = rig(5);
    let target = DotTarget { columns: 11, rows: 8, ..DotTarget::for_rig(&rig, 14) };
    let drift = Case::new(&rig, &target, |i| [i as f64 - 2.0, 0.0]);
    assert!(drift.worst < 0.3 && !drift.is_ambiguous(), "{}", drift.worst);
}

#[test]
#[ignore = "more cases of a test"]
fn more_jumps_are_told_by_the_end_of_the_grid() {
    jumps(&[[0.0, 0.0], [1.0, 0.0]]);
}

#[test]
fn the_end_of_the_grid_that_only_the_smallest_slices_show_makes_all_slices_certain() {
    let rig = rig(9);
    // in the reference slice the rows end within a pitch of the borders of the image
    let target = DotTarget { columns: 29, rows: 21, ..DotTarget::for_rig(&rig, 28) };
    let case = Case::new(&rig, &target, |_| [0.0; 2]);
    assert!(case.worst < 0.3 && !case.is_ambiguous(), "{}", case.worst);
    // the same view of a larger grid
    let larger = DotTarget { columns: 34, rows: 26, ..target };
    assert!(Case::new(&rig, &larger, |_| [0.0; 2]).is_ambiguous());
}

#[test]
fn an_endless_perfect_grid_is_ambiguous() {
    let rig = rig(5);
    for drift in [0.0, 1.0] {
        let case = Case::new(&rig, &endless(&rig), |i| [drift * (i as f64 - 2.0), 0.0]);
        assert!(case.is_ambiguous());
        assert!(case.calibration.report.grade > Grade::Good);
    }
}

fn endless_with_flaws(by: [f64; 2]) {
    let rig = rig(5);
    let dirty = DotTarget { flaws: Flaws { target_dust: 60, ..Flaws::default() }, ..endless(&rig) };
    for target in [endless(&rig).without(0.03, 2), dirty] {
        let case = Case::new(&rig, &target, jump(3, by));
        assert!(case.worst < 0.5 && !case.is_ambiguous(), "{by:?}: {}", case.worst);
    }
}

#[test]
fn missing_dots_and_dirt_tell_shifts_of_an_endless_grid_apart() {
    endless_with_flaws([0.0, -1.0]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_shifts_of_an_endless_grid_are_told_apart_by_missing_dots_and_dirt() {
    endless_with_flaws([0.0, 0.0]);
}

#[test]
fn dust_on_the_sensor_does_not_prove_that_nothing_moved() {
    let rig = rig(5);
    let flaws = Flaws { sensor_dust: 40, ..Flaws::default() };
    let target = DotTarget { flaws, ..endless(&rig) };
    // here the target moves and the sensor does not
    let shown = |i: usize| DotTarget {
        offset_mm: [target.offset_mm[0] + (i as f64 - 2.0) * target.pitch_mm, target.offset_mm[1]],
        ..target.clone()
    };
    let pictures: Vec<Raster> = (0..5).map(|i| render_target(&rig, &shown(i), i)).collect();
    let calibration = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
    println!("{} {:?}", calibration.verdict, calibration.warnings);
    assert!(calibration.warnings.iter().any(|w| w.code == "shift_ambiguous"));
}

/// A finite grid whose blur reaches `share` of the pitch at the ends of the stack.
fn finite(slices: usize, share: f64) -> (Rig, DotTarget) {
    let rig = rig(slices);
    let target = DotTarget { columns: 10, rows: 7, ..DotTarget::for_rig(&rig, 14) };
    let now = target.blur_radius_px(&rig, slices - 1) / target.pitch_px(&rig, slices - 1);
    (Rig { f_number: rig.f_number * now / share, ..rig }, target)
}

#[test]
fn a_displaced_slice_is_measured_by_its_own_dots_and_named_alone() {
    let (rig, target) = finite(7, 0.5);
    let case = Case::new(&rig, &target, |i| if i == 6 { [0.45, 0.15] } else { [0.0; 2] });
    assert!(case.worst < 0.3, "{}", case.worst);
    assert!(case.says("slice_displaced") && !case.says("rig_bumped") && !case.says("slice_interpolated"));
    assert!(case.calibration.slices.iter().all(|s| !s.interpolated));
}

#[test]
fn slices_that_are_not_in_the_order_of_the_rail_are_named() {
    let (rig, target) = finite(6, 0.2);
    let narrow: Vec<Raster> = (0..6).map(|i| part(&render_target(&wide(&rig), &target, i), MARGIN)).collect();
    for order in [[4, 5, 0, 1, 2, 3], [3, 2, 4, 1, 5, 0]] {
        let pictures = order.map(|i: usize| narrow[i].clone());
        let calibration = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl).expect("a calibration");
        let codes: Vec<&str> = calibration.warnings.iter().map(|w| w.code.as_str()).collect();
        assert_eq!(codes, ["slices_out_of_order"], "{:?}", calibration.warnings);
        assert!(calibration.report.grade > Grade::Good);
    }
}

#[test]
fn mirrored_and_turned_slices_are_refused_by_name() {
    let (rig, target) = finite(5, 0.2);
    let marked = target.without(0.08, 3);
    let narrow: Vec<Raster> = (0..5).map(|i| part(&render_target(&wide(&rig), &marked, i), MARGIN)).collect();
    let edited = |index: usize, edit: &dyn Fn(&mut [u8])| {
        let mut pictures = narrow.clone();
        let Samples::Eight(samples) = &mut pictures[index].samples else { panic!("rendered with 8 bits") };
        edit(samples);
        calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl)
    };
    let mirror = |s: &mut [u8]| s.chunks_exact_mut(400).for_each(<[u8]>::reverse);
    let turn = |s: &mut [u8]| s.reverse();
    for (index, edit, word) in [(3, &mirror as &dyn Fn(&mut [u8]), "is mirrored"), (0, &turn, "is turned")] {
        let Err(Interrupted::Failed(fault)) = edited(index, edit) else { panic!("not refused") };
        assert_eq!(fault.kind, ErrorKind::TargetNotFound);
        assert!(fault.detail.contains(word) && fault.detail.contains(&format!("slice {index}")), "{}", fault.detail);
    }
}
