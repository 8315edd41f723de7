//! Findings of the metrics: each fault of a stack is simulated, and must be the only finding. A stack without a fault
//! must have none.

use std::sync::LazyLock;

use rayon::prelude::*;

use crate::{
    fusion::{Fused, FusionRequest, Plan, fuse, tests::rendered::true_plan},
    imaging::{Plane, Raster, Samples},
    quality::StackQuality,
    synth::{
        Light, Rig, Scene, Stage,
        scene::{Relief, SCENES},
    },
    types::{
        Homography, NoControl,
        fusion_options::Method,
        metrics::{Finding, Severity},
    },
};

mod displacements;

/// A rendered stack with its plan, possibly with a fault.
#[derive(Clone)]
struct Stack {
    slices: Vec<Raster>,
    plan: Plan,
    object: Plane<u8>,
}

impl Stack {
    fn of(rig: &Rig, scene: &Scene) -> Self {
        let stage = Stage::new(rig, scene);
        let slices = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
        // the method of a job by default
        Self { slices, plan: Plan { method: Method::HaloCorrected, ..true_plan(rig) }, object: stage.mask() }
    }

    fn count(&self) -> usize {
        self.slices.len()
    }

    fn fused(&self, masked: bool) -> Fused {
        let request = FusionRequest { metrics: true, object: masked.then_some(&self.object), shown: None };
        fuse(&&self.slices[..], &self.plan, &request, &std::env::temp_dir(), &NoControl).unwrap()
    }

    fn findings(&self, masked: bool) -> Vec<Finding> {
        self.fused(masked).quality.unwrap().findings
    }

    /// Only the slices for which `keep` is true, and their part of the plan.
    fn only(mut self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.count()).filter(|&n| keep(n)).collect();
        let pick = |n: &usize| self.slices[*n].clone();
        self.slices = kept.iter().map(pick).collect();
        self.plan.slices = kept.iter().map(|&n| self.plan.slices[n]).collect();
        self.plan.reference = kept.len() / 2;
        self
    }

    fn swapped(mut self, a: usize, b: usize) -> Self {
        self.slices.swap(a, b);
        self
    }

    fn doubled(mut self, slice: usize) -> Self {
        self.slices[slice] = self.slices[slice - 1].clone();
        self
    }

    /// The samples of a slice multiplied by a factor per channel.
    fn scaled(mut self, slice: usize, by: [f32; 3]) -> Self {
        let Samples::Eight(samples) = &mut self.slices[slice].samples else { panic!("8 bits expected") };
        for pixel in samples.chunks_exact_mut(3) {
            pixel
                .iter_mut()
                .zip(by)
                .for_each(|(sample, by)| *sample = (f32::from(*sample) * by).round().min(255.0) as u8);
        }
        self
    }

    /// Each homography followed by a similarity (scale, shift) about the centre of the image.
    fn with_profile_error(mut self, left: impl Fn(f64) -> (f64, [f64; 2])) -> Self {
        let middle = [(self.plan.width as f64 - 1.0) / 2.0, (self.plan.height as f64 - 1.0) / 2.0];
        for n in 0..self.count() {
            let (scale, shift) = left(n as f64);
            let shift = [0, 1].map(|axis: usize| middle[axis] * (1.0 - scale) + shift[axis]);
            let moved = self.plan.slices[n].homography.then(&Homography::similarity(scale, shift)).unwrap();
            self.plan.slices[n].homography = moved;
        }
        self
    }
}

type Error = (&'static str, fn(Stack) -> Stack);

const FAULTS: [Error; 15] = [
    ("", |stack| stack),
    ("range_too_short_near", |stack| {
        let n = stack.count();
        stack.only(|i| i >= n / 3)
    }),
    ("range_too_short_far", |stack| {
        let n = stack.count();
        stack.only(|i| i < n - n / 3)
    }),
    ("coverage_gap", |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2 - 1 || i > n / 2 + 1)
    }),
    ("uneven_step", |stack| {
        let n = stack.count();
        stack.only(|i| i != n / 2)
    }),
    ("slices_out_of_order", |stack| {
        let n = stack.count();
        stack.swapped(n / 2, n / 2 + 2)
    }),
    ("duplicate_slice", |stack| {
        let n = stack.count();
        stack.doubled(n / 2)
    }),
    ("exposure_flicker", |stack| {
        let n = stack.count();
        stack.scaled(n / 2 + 1, [0.93; 3])
    }),
    ("white_balance_drift", |stack| {
        let n = stack.count();
        stack.scaled(n / 2 - 1, [1.04, 0.985, 1.0])
    }),
    ("exposure_drift", |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| s.scaled(i, [1.0 - 0.2 * i as f32 / n as f32; 3]))
    }),
    ("slice_misaligned", |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i == n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("picture_jumps", |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i >= n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("profile_misfit", |stack| {
        let n = stack.count() as f64;
        stack.with_profile_error(|i| (1.0 + 0.012 * (i / n - 0.5), [0.0; 2]))
    }),
    ("slices_reversed", |mut stack| {
        stack.slices.reverse();
        stack
    }),
    ("clipped", |stack| (0..stack.count()).fold(stack, |s, i| s.scaled(i, [3.0; 3]))),
];

/// Codes of the findings with severity warning.
fn warning_codes(stack: &Stack, masked: bool) -> Vec<String> {
    let findings = stack.findings(masked).into_iter();
    findings.filter(|finding| finding.severity == Severity::Warning).map(|finding| finding.code).collect()
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
        for (width, height, count) in [(480, 360, 11), (360, 240, 9)] {
            for seed in 1..=3 {
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

/// Faults that a scene cannot show: its step is so fine that a missing slice loses nothing, or too few pixels are
/// bright.
const CANNOT_SHOW: [&[&str]; 5] =
    [&["uneven_step"], &["uneven_step", "clipped"], &["uneven_step"], &["uneven_step", "clipped"], &["uneven_step"]];

/// Pairs of a fault and another code that is correct too: a gap without lost detail is only a long step.
const ALSO_CORRECT: [(&str, &str); 1] = [("coverage_gap", "uneven_step")];

/// All scenes with seed 4, for the tests that share them.
static OF_SEED_4: LazyLock<[Stack; 5]> =
    LazyLock::new(|| SCENES.map(|(_, scene)| Stack::of(&Rig { seed: 4, ..Rig::sized(480, 360, 11) }, &scene(4))));

#[test]
fn each_fault_is_reported_on_all_scenes_that_can_show_it() {
    let mut wrong = Vec::new();
    for (((name, _), clean), but) in SCENES.into_iter().zip(&*OF_SEED_4).zip(CANNOT_SHOW) {
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

/// Prints how often `exposure_drift` is reported, by scene and drift: the figures for that finding in
/// `docs/METRICS.md`.
#[test]
#[ignore = "a table for the documentation, minutes long: --ignored --nocapture"]
fn table_of_exposure_drift() {
    for (name, scene) in SCENES {
        for (width, height, count) in [(480, 360, 11), (720, 480, 13)] {
            let of_seed = |seed: u64| Stack::of(&Rig { seed, ..Rig::sized(width, height, count) }, &scene(seed));
            let stacks: Vec<Stack> = (1..=3).map(of_seed).collect();
            for share in [0.0, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.1, 0.15, 0.2] {
                let reported =
                    |stack: &Stack| warning_codes(&drifting(stack, share), true).contains(&"exposure_drift".to_owned());
                let count = stacks.iter().filter(|stack| reported(stack)).count();
                println!("{name} {width} x {height}, {:.0} %: {count} of 3", 100.0 * share);
            }
        }
    }
}

/// The findings (notes are marked with `~`) and the main metrics of a stack; -1 for a metric that could not be
/// measured.
fn summary(quality: &StackQuality) -> String {
    let codes: Vec<String> = quality
        .findings
        .iter()
        .map(|finding| {
            let mark = if finding.severity == Severity::Note { "~" } else { "" };
            format!("{mark}{}{:?}", finding.code, finding.slices)
        })
        .collect();
    let of = |value: Option<f64>| value.unwrap_or(-1.0);
    let (alignment, focus, fusion) = (&quality.alignment, &quality.focus, &quality.fusion);
    let drift = alignment.similarity.as_ref();
    [
        codes.join(" "),
        format!(
            "| drift {:.2}+-{:.2}",
            of(drift.map(|d| d.corner_drift_px)),
            of(drift.map(|d| d.corner_drift_sigma_px))
        ),
        format!("n {} p95 {:.2} |", drift.map_or(0, |d| d.shifts), of(alignment.residual_p95_px)),
        format!("peak {:.3} {:.3}", of(focus.peak_at_first_fraction), of(focus.peak_at_last_fraction)),
        format!("label {:.3} amb {:.3}", of(focus.label_noise), of(focus.ambiguity)),
        format!("tex {:.2}", of(focus.textured_fraction)),
        format!("over {:.4} {:.3}", of(fusion.overshoot_fraction), of(fusion.overshoot_levels)),
        format!("clip {:.4} common {:.3}", of(fusion.clipped_fraction), of(alignment.common_fraction)),
    ]
    .join(" ")
}

/// Prints the findings and the main metrics of stacks with each fault: the figures on findings in `docs/METRICS.md`.
#[test]
#[ignore = "a table for the documentation, minutes long: --ignored --nocapture"]
fn table_of_findings_by_fault() {
    let cases: Vec<(usize, usize, usize, u64, usize)> = vec![
        (480, 360, 11, 1, 0),
        (480, 360, 11, 1, 1),
        (480, 360, 11, 1, 2),
        (640, 440, 9, 2, 0),
        (640, 440, 9, 2, 1),
        (640, 440, 9, 2, 2),
        (400, 520, 15, 3, 0),
        (400, 520, 15, 3, 1),
        (400, 520, 15, 3, 2),
    ];
    cases.into_iter().for_each(|(width, height, count, seed, scene)| {
        let rig = Rig { seed, ..Rig::sized(width, height, count) };
        let (name, make) = SCENES[scene];
        let clean = Stack::of(&rig, &make(seed));
        for masked in [true, false] {
            let lines: Vec<String> = FAULTS
                .par_iter()
                .map(|(fault, make)| {
                    let quality = make(clean.clone()).fused(masked).quality.unwrap();
                    format!("{name} {width}x{height}x{count} masked {masked} [{fault}]: {}", summary(&quality))
                })
                .collect();
            lines.iter().for_each(|line| println!("{line}"));
        }
    });
}

/// Prints the findings and metrics of real stacks, as far as they are beside the repository.
#[test]
#[ignore = "needs images that are not in the repository: --ignored --nocapture"]
fn table_of_findings_on_real_stacks() {
    let shared = std::env::var_os("PINSTACK_SHARED").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        std::path::PathBuf::from,
    );
    for name in ["coffee6", "flies9", "newto12", "pcb7", "pcb_depth10"] {
        let Ok(folder) = std::fs::read_dir(shared.join("data").join(name)) else { continue };
        let mut files: Vec<_> = folder.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| {
            file.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg")) && !file.ends_with("expected.jpg")
        });
        files.sort();
        let slices: Vec<Raster> = files
            .iter()
            .map(|file| {
                let image = image::open(file).unwrap().into_rgb8();
                Raster::eight(image.width() as usize, image.height() as usize, 3, image.into_raw())
            })
            .collect();
        let plan = Plan::aligned(slices[0].width, slices[0].height, slices.len());
        let request = FusionRequest { metrics: true, object: None, shown: None };
        let quality = fuse(&&slices[..], &plan, &request, &std::env::temp_dir(), &NoControl).unwrap().quality.unwrap();
        println!("{name}\n{:#?}\n{:?}\n{:?}\n{:?}", quality.findings, quality.fusion, quality.focus, quality.alignment);
    }
}
