//! Accuracy of calibrations from stacks of objects, without a target, on rendered stacks with known truth. `cargo bench
//! --bench calibration_stacks -- [--seeds N] [--width PX]`
//!
//! Each line is one rig with one or several stacks of one scene: the worst image corner against the truth, and how many
//! of the stated standard deviations that is. The summary serves to compare two versions. The last lines count the
//! capture modes that are found from the slices, without the options that tell them.

use std::sync::Arc;

use pinstack_science::{
    calibration::{Calibration, calibrate_by_stacks},
    imaging::Slices,
    synth::{Light, Rendered, Rig, Stage, scene::SCENES, turntable},
    types::{
        NoControl, calibration_options::CalibrationOptions, profile::CaptureMode, report::Grade, view::ViewAngles,
    },
};

/// Value of an option of the command line.
fn option(name: &str, default: usize) -> usize {
    let arguments: Vec<String> = std::env::args().collect();
    let place = arguments.iter().position(|a| a == name);
    place.and_then(|k| arguments.get(k + 1)).and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// What differs from the typical rig.
type Change = fn(Rig) -> Rig;

const RIGS: [(&str, usize, Change); 7] = [
    ("typical", 15, |rig| rig),
    ("few slices", 6, |rig| rig),
    ("many slices", 30, |rig| rig),
    ("noise", 15, |rig| Rig { noise: 4.0, ..rig }),
    ("no rotation", 15, |rig| Rig { rotation_deg: 0.0, keystone: [0.0; 2], ..rig }),
    ("exact rail", 15, |rig| Rig { drift_px: [0.0; 2], ..rig }),
    ("little breathing", 15, |rig| {
        let rail_mm = rig.rail_mm.iter().map(|z| z / 20.0).collect();
        Rig { rail_mm, f_number: rig.f_number / 20.0, ..rig }
    }),
];

/// Worst corner, px, and in stated standard deviations.
fn errors(found: &Calibration, rig: &Rig) -> [f64; 2] {
    let (width, height) = (rig.width as u32, rig.height as u32);
    found.slices.iter().filter(|s| s.index as usize != rig.reference).fold([0.0; 2], |[px, sigmas], slice| {
        let off = slice.homography.corner_distance(&rig.homography(slice.index as usize), width, height);
        let sigma = slice.corner_sigma_px.unwrap_or(f64::NAN);
        [f64::max(px, off), f64::max(sigmas, off / sigma)]
    })
}

struct Outcome {
    is_scan: bool,
    /// `None` without a profile.
    errors: Option<[f64; 2]>,
    is_good: bool,
}

fn outcome(name: &str, rig: &Rig, views: &[Rendered]) -> Outcome {
    let slices: Vec<&dyn Slices> = views.iter().map(|view| view as &dyn Slices).collect();
    let found = calibrate_by_stacks(&slices, &CalibrationOptions::default(), &NoControl);
    let errors = found.as_ref().ok().map(|found| errors(found, rig));
    match (&found, errors) {
        (Ok(found), Some([px, sigmas])) => println!(
            "{name:40} {px:7.3} px {sigmas:5.1} sigmas  {:?}, {}",
            found.report.grade, found.report.model_reason
        ),
        (Err(why), _) => println!("{name:40} {why}"),
        _ => {}
    }
    Outcome { is_scan: views.len() > 1, errors, is_good: found.is_ok_and(|found| found.report.grade == Grade::Good) }
}

/// Per mode: right, unknown and wrong ones.
fn modes(seeds: u64, width: usize) {
    for mode in [CaptureMode::FixedLens, CaptureMode::MovingLens] {
        let mut counts = [0; 3];
        for (scene, from_seed) in SCENES {
            for (slices, growth) in [(7, 1.0), (15, 0.2), (15, 2.5), (30, 1.0)] {
                for seed in 1..=seeds {
                    let rig = Rig { softness_px: 0.5, seed, ..Rig::sized(width, width * 2 / 3, slices) };
                    let rail_mm = rig.rail_mm.iter().map(|z| z * growth).collect();
                    let rig = Rig { rail_mm, f_number: rig.f_number * growth, ..rig };
                    let rig = if mode == CaptureMode::MovingLens { rig.moving_lens() } else { rig };
                    let view = Rendered::scene(Arc::new(Stage::new(&rig, &from_seed(seed))), Light::Front);
                    let found = calibrate_by_stacks(&[&view], &CalibrationOptions::default(), &NoControl);
                    let Ok(found) = found else { continue };
                    let kind = found.report.capture.found.map_or(1, |found| if found == mode { 0 } else { 2 });
                    counts[kind] += 1;
                    println!("{mode:?}, {scene} {seed}, {slices} slices x {growth}: {}", found.report.capture.detail);
                }
            }
        }
        let [right, unknown, wrong] = counts;
        println!("{mode:?}: {right} found, {unknown} unknown, {wrong} wrong");
    }
}

fn main() {
    let (seeds, width) = (option("--seeds", 2) as u64, option("--width", 720));
    let mut all = Vec::new();
    for (scene, from_seed) in SCENES {
        for (what, slices, change) in RIGS {
            for seed in 1..=seeds {
                let rig = change(Rig { softness_px: 0.5, seed, ..Rig::sized(width, width * 2 / 3, slices) });
                let stage = Arc::new(Stage::new(&rig, &from_seed(seed)));
                all.push(outcome(&format!("{scene} {seed}, {what}"), &rig, &[Rendered::scene(stage, Light::Front)]));
            }
        }
    }
    for seed in 1..=seeds {
        let rig = Rig { seed, ..turntable::scan_rig(width, 15) };
        let specimen = turntable::Specimen::beetle(seed);
        let view = |k: u32| {
            let angles = ViewAngles { pan_deg: 30.0 * f64::from(k), tilt_deg: 15.0 };
            Rendered::scene(Arc::new(turntable::view(&rig, &specimen, angles)), Light::Front)
        };
        let views: Vec<Rendered> = (0..12).map(view).collect();
        all.push(outcome(&format!("beetle {seed}, 12 views"), &rig, &views));
    }
    for is_scan in [false, true] {
        let some: Vec<&Outcome> = all.iter().filter(|outcome| outcome.is_scan == is_scan).collect();
        let quantile = |k: usize, q: f64| {
            let mut values: Vec<f64> = some.iter().filter_map(|o| o.errors.map(|e| e[k])).collect();
            values.sort_by(f64::total_cmp);
            values.get(((values.len() as f64 - 1.0) * q).round() as usize).copied().unwrap_or(f64::NAN)
        };
        println!(
            "{}: {} of {} with a profile, {} called good; worst corner: median {:.2}, 95 % {:.2}, largest {:.2} px; in \
             stated standard deviations: median {:.1}, 95 % {:.1}, largest {:.1}",
            if is_scan { "scans" } else { "single stacks" },
            some.iter().filter(|o| o.errors.is_some()).count(),
            some.len(),
            some.iter().filter(|o| o.is_good).count(),
            quantile(0, 0.5),
            quantile(0, 0.95),
            quantile(0, 1.0),
            quantile(1, 0.5),
            quantile(1, 0.95),
            quantile(1, 1.0),
        );
    }
    modes(seeds, width);
}
