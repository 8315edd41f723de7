//! Findings of the metrics: each fault of a stack is simulated, and must be the only finding. A stack without a fault
//! must have none.
//!
//! A fusion takes about half a second of CPU time and a stack two, so stacks are shared, and some tests take a part of
//! their cases; the ignored tests `more_...` take the others.

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

/// Which cases of a test are taken.
#[derive(Clone, Copy, PartialEq)]
enum Cases {
    /// Those of the test itself.
    Few,
    /// All others, in a test that is ignored.
    Others,
}

impl Cases {
    /// Whether a case is taken. `is_first`: it belongs to the few.
    fn take(self, is_first: bool) -> bool {
        is_first == (self == Self::Few)
    }
}

#[test]
fn each_fault_is_the_only_warning_on_an_insect() {
    // the step is so fine that a missing slice loses nothing
    each_fault_alone(&Rig::sized(480, 360, 11), &Scene::insect(1), &["uneven_step"]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_faults_are_the_only_warning_on_an_insect() {
    // few pixels are bright in all channels
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
    let stacks = OF_SEED_4.iter().chain(&*SMALL);
    let found: Vec<_> = stacks.map(|stack| warning_codes(stack, true)).collect();
    assert!(found.iter().all(Vec::is_empty), "{found:#?}");
}

#[test]
#[ignore = "more cases of a test"]
fn more_stacks_without_faults_have_no_warning() {
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

/// Plates in focus near both ends; neighbouring slices hardly differ.
fn fine_steps(seed: u64) {
    let stack = Stack::of(&Rig { seed, ..Rig::sized(480, 360, 40) }, &Scene::plates(seed));
    assert_eq!(warning_codes(&stack, true), [""; 0], "seed {seed}");
    for (near, code) in [(true, "range_too_short_near"), (false, "range_too_short_far")] {
        let shortened = stack.clone().only(|i| if near { i >= 13 } else { i < 27 });
        assert_eq!(warning_codes(&shortened, true), [code], "seed {seed}");
    }
}

#[test]
fn fine_steps_do_not_make_the_range_seem_too_short() {
    fine_steps(1);
}

#[test]
#[ignore = "more cases of a test"]
fn more_fine_steps_do_not_make_the_range_seem_too_short() {
    fine_steps(4);
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

/// All scenes, smaller and with seed 5.
static SMALL: LazyLock<[Stack; 5]> =
    LazyLock::new(|| SCENES.map(|(_, scene)| Stack::of(&Rig { seed: 5, ..Rig::sized(360, 240, 9) }, &scene(5))));

/// Each fault on one scene that can show it, or on the others.
fn faults_on_other_scenes(cases: Cases) {
    let scenes: Vec<_> = SCENES.into_iter().zip(&*OF_SEED_4).skip(TESTED_ALONE).zip(CANNOT_SHOW).collect();
    let mut wrong = Vec::new();
    for (n, (fault, make)) in FAULTS.iter().enumerate().filter(|(_, (fault, _))| !fault.is_empty()) {
        // every scene gets a part of the faults
        let from_nth = (0..scenes.len()).map(|i| &scenes[(n + i) % scenes.len()]);
        let showing = from_nth.filter(|(_, but)| !but.contains(fault)).enumerate();
        for (_, (((name, _), clean), _)) in showing.filter(|(i, _)| cases.take(*i == 0)) {
            let found = warning_codes(&make((*clean).clone()), true);
            println!("{name} [{fault}]: {found:?}");
            let is_named = |code: &String| code == fault || ALSO_CORRECT.contains(&(fault, code.as_str()));
            if !found.iter().any(is_named) {
                wrong.push(format!("{fault} on {name} was reported as {found:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn each_fault_is_reported_on_another_scene_that_can_show_it() {
    faults_on_other_scenes(Cases::Few);
}

#[test]
#[ignore = "more cases of a test"]
fn more_faults_are_reported_on_the_other_scenes_that_can_show_them() {
    faults_on_other_scenes(Cases::Others);
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

fn empty_depths(cases: Cases) {
    for (n, &(name, scene)) in SCENES[..4].iter().enumerate().filter(|(n, _)| cases.take(*n == 1)) {
        let stack = Stack::of(&Rig { seed: 6, ..Rig::sized(480, 360, 15) }, &with_empty_middle(scene(6)));
        let findings = stack.findings(true);
        let redundant = findings.iter().find(|finding| finding.code == "redundant_slices");
        println!("{n}, {name}: {findings:?}");
        // not the reference slice, 7: it has the pixels that are sharp in no slice
        let slices = redundant.map(|finding| finding.slices.clone()).unwrap_or_default();
        assert!(slices.contains(&6) && slices.iter().all(|slice| (3..=11).contains(slice)), "{name}: {findings:?}");
    }
}

#[test]
fn slices_of_empty_depths_are_reported_as_redundant() {
    empty_depths(Cases::Few);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_of_empty_depths_are_reported_as_redundant() {
    empty_depths(Cases::Others);
}

/// A profile that does not fit, with slices of these scenes that are clipped.
fn clipped_misfits(scenes: &[usize]) {
    for &scene in scenes {
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

#[test]
fn a_profile_that_does_not_fit_is_reported_for_clipped_slices_too() {
    clipped_misfits(&[0]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_profiles_that_do_not_fit_are_reported_for_clipped_slices_too() {
    clipped_misfits(&[2, 4]);
}

/// A stack whose brightness drifts by `share` from the first slice to the last.
fn drifting(clean: &Stack, share: f32) -> Stack {
    let last = (clean.count() - 1) as f32;
    (0..clean.count()).fold(clean.clone(), |stack, slice| stack.scaled(slice, [1.0 - share * slice as f32 / last; 3]))
}

fn drifts(cases: Cases) {
    for (n, ((name, _), clean)) in SCENES.into_iter().zip(&*SMALL).enumerate() {
        // relative to the reference slice, in the middle, the drift is about half of this
        let shares = [(0.0, false), (0.02, false), (0.04, false), (0.08, true), (0.15, true)];
        // the few: those beside the limit, each on two scenes
        let few = |share: f32| (share == 0.04 && n < 2) || (share == 0.08 && (1..3).contains(&n));
        for (share, reported) in shares.into_iter().filter(|(share, _)| cases.take(few(*share))) {
            let found = warning_codes(&drifting(clean, share), true);
            println!("{name} {share}: {found:?}");
            assert_eq!(found.iter().any(|code| code == "exposure_drift"), reported, "{name} {share}: {found:?}");
        }
    }
}

#[test]
fn a_drift_of_brightness_of_more_than_three_per_cent_is_reported() {
    drifts(Cases::Few);
}

#[test]
#[ignore = "more cases of a test"]
fn more_drifts_of_brightness_of_more_than_three_per_cent_are_reported() {
    drifts(Cases::Others);
}
