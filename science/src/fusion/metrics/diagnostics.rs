//! Findings of the metrics: each fault of a stack is simulated, and must be the only finding. A stack without a fault
//! must have none.

mod displacements;
mod faulty_stack;
mod foreign;
mod tables;

use std::sync::LazyLock;

use rayon::prelude::*;

use crate::{
    synth::{
        Rig, Scene,
        scene::{Relief, SCENES},
    },
    types::metrics::{Finding, Severity},
};
use faulty_stack::{FAULTS, Stack};

/// Codes of the findings with severity warning.
fn warning_codes(stack: &Stack, masked: bool) -> Vec<String> {
    let findings = stack.findings(masked).into_iter();
    findings.filter(|finding| finding.severity == Severity::Warning).map(|finding| finding.code.to_string()).collect()
}

/// `but` are the faults that this scene cannot show.
fn each_fault_alone(rig: &Rig, scene: &Scene, but: &[&str]) {
    let clean = Stack::of(rig, scene);
    let wrong: Vec<String> = FAULTS
        .par_iter()
        .filter(|(fault, _)| !but.contains(fault))
        .filter_map(|(fault, make)| {
            let expected: Vec<&str> = if fault.is_empty() { Vec::new() } else { vec![fault] };
            let found = warning_codes(&make(clean.clone()), true);
            let also_correct = ALSO_CORRECT.iter().any(|(name, other)| name == fault && found == [*other]);
            (found != expected && !also_correct).then(|| format!("{expected:?} was reported as {found:?}"))
        })
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn each_fault_is_the_only_warning_on_an_insect() {
    // the step is so fine that a missing slice loses nothing
    each_fault_alone(&Rig::sized(480, 360, 11), &Scene::insect(1), &["uneven_step"]);
    // in the second scene few pixels are bright in all channels
    let but = ["uneven_step", "clipped"];
    each_fault_alone(&Rig { seed: 2, ..Rig::sized(640, 440, 9) }, &Scene::insect(2), &but);
}

#[test]
fn each_fault_is_the_only_warning_on_a_flower() {
    // few parts of the scene are near, and none is bright
    let but = ["uneven_step", "range_too_short_near", "clipped"];
    each_fault_alone(&Rig::sized(480, 360, 11), &Scene::flower(1), &but);
}

#[test]
fn a_stack_without_faults_has_no_warning() {
    let mut wrong = Vec::new();
    for (name, scene) in SCENES {
        for (width, height, count, seeds) in [(480, 360, 11, 1), (360, 240, 9, 3)] {
            for seed in 1..=seeds {
                let stack = Stack::of(&Rig { seed, ..Rig::sized(width, height, count) }, &scene(seed));
                let found = warning_codes(&stack, true);
                println!("{name} {width} x {height}, seed {seed}: {found:?}");
                if !found.is_empty() {
                    wrong.push(format!("{name} {width} x {height}, seed {seed}: {found:?}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn fine_steps_do_not_make_the_range_seem_too_short() {
    // plates in focus near both ends; neighbouring slices hardly differ
    for seed in [1, 4] {
        let stack = Stack::of(&Rig { seed, ..Rig::sized(480, 360, 40) }, &Scene::plates(seed));
        assert_eq!(warning_codes(&stack, true), [""; 0], "seed {seed}");
        for (near, code) in [(true, "range_too_short_near"), (false, "range_too_short_far")] {
            let shortened = stack.clone().only(|i| if near { i >= 13 } else { i < 27 });
            assert_eq!(warning_codes(&shortened, true), [code], "seed {seed}");
        }
    }
}

/// Scenes of tests of their own: the first one.
const TESTED_ALONE: usize = 1;

/// Faults that each other scene cannot show: its step is so fine that a missing slice loses nothing, or too few pixels
/// are bright.
const CANNOT_SHOW: [&[&str]; 4] =
    [&["uneven_step", "clipped"], &["uneven_step"], &["uneven_step", "clipped"], &["uneven_step"]];

/// Pairs of a fault and another code that is correct too: a gap without lost detail is only a long step.
const ALSO_CORRECT: [(&str, &str); 1] = [("coverage_gap", "uneven_step")];

/// All scenes with seed 4, for the tests that share them.
static OF_SEED_4: LazyLock<[Stack; 5]> =
    LazyLock::new(|| SCENES.map(|(_, scene)| Stack::of(&Rig { seed: 4, ..Rig::sized(480, 360, 11) }, &scene(4))));

#[test]
fn each_fault_is_reported_on_the_other_scenes_that_can_show_it() {
    let mut wrong = Vec::new();
    for (((name, _), clean), but) in SCENES.into_iter().zip(&*OF_SEED_4).skip(TESTED_ALONE).zip(CANNOT_SHOW) {
        for (fault, make) in FAULTS.iter().filter(|(fault, _)| !fault.is_empty()) {
            let found = warning_codes(&make(clean.clone()), true);
            println!("{name} [{fault}]: {found:?}");
            let is_named = |code: &String| code == fault || ALSO_CORRECT.contains(&(fault, code.as_str()));
            if !but.contains(fault) && !found.iter().any(is_named) {
                wrong.push(format!("{fault} on {name} was reported as {found:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The scene without parts in the middle of the depth range: near parts are moved nearer, far parts farther.
fn with_empty_middle(mut scene: Scene) -> Scene {
    let away = |depth: f64| if depth < 0.5 { 0.5 * depth } else { 0.5 + 0.5 * depth };
    for part in &mut scene.parts {
        match &mut part.relief {
            Relief::Dome { depth, slope, bulge, .. } => {
                *depth = away(*depth);
                *slope = slope.map(|slope| 0.3 * slope);
                *bulge *= 0.3;
            }
            Relief::Along { depths, .. } => {
                let middle = f64::midpoint(depths[0], depths[1]);
                *depths = depths.map(|depth| away(middle) + 0.3 * (depth - middle));
            }
        }
    }
    scene
}

#[test]
fn slices_of_empty_depths_are_reported_as_redundant() {
    for &(name, scene) in &SCENES[..4] {
        let stack = Stack::of(&Rig { seed: 6, ..Rig::sized(480, 360, 15) }, &with_empty_middle(scene(6)));
        let findings = stack.findings(true);
        let redundant = findings.iter().find(|finding| finding.code == "redundant_slices");
        println!("{name}: {redundant:?}, {:?}", warning_codes(&stack, true));
        // not the reference slice, 7: it has the pixels that are sharp in no slice
        let slices = redundant.map(|finding| finding.slices.clone()).unwrap_or_default();
        assert!(slices.contains(&6) && slices.iter().all(|slice| (3..=11).contains(slice)), "{name}: {findings:?}");
    }
}

#[test]
fn a_profile_that_does_not_fit_is_reported_for_clipped_slices_too() {
    for scene in [0, 2, 4] {
        let (name, clean) = (SCENES[scene].0, &OF_SEED_4[scene]);
        let clipped = (0..clean.count()).fold(clean.clone(), |stack, slice| stack.scaled(slice, [2.0; 3]));
        let right = warning_codes(&clipped, true);
        let n = clipped.count() as f64;
        let wrong = warning_codes(&clipped.with_profile_error(|i| (1.0 + 0.012 * (i / n - 0.5), [0.0; 2])), true);
        println!("{name}: {right:?}, {wrong:?}");
        assert!(right.iter().all(|code| code != "profile_misfit"), "{name}: {right:?}");
        assert!(wrong.iter().any(|code| code == "profile_misfit"), "{name}: {wrong:?}");
    }
}

/// A stack whose brightness drifts by `share` from the first slice to the last.
fn drifting(clean: &Stack, share: f32) -> Stack {
    let last = (clean.count() - 1) as f32;
    (0..clean.count()).fold(clean.clone(), |stack, slice| stack.scaled(slice, [1.0 - share * slice as f32 / last; 3]))
}

#[test]
fn a_drift_of_brightness_of_more_than_three_per_cent_is_reported() {
    for (name, scene) in SCENES {
        let clean = Stack::of(&Rig { seed: 5, ..Rig::sized(360, 240, 9) }, &scene(5));
        // relative to the reference slice, in the middle, the drift is about half of this
        for (share, reported) in [(0.0, false), (0.02, false), (0.04, false), (0.08, true), (0.15, true)] {
            let found = warning_codes(&drifting(&clean, share), true);
            println!("{name} {share}: {found:?}");
            assert_eq!(found.iter().any(|code| code == "exposure_drift"), reported, "{name} {share}: {found:?}");
        }
    }
}
