//! Each fault of a stack is made, and must be named, it alone; on the stack without it nothing may be.

use rayon::prelude::*;

use crate::{
    fusion::{Fused, Plan, Watch, fuse},
    imaging::{Plane, Raster, Samples},
    model::{
        Homography, Unwatched,
        metrics::{Finding, Severity},
    },
    synth::{Light, Rig, Scene, Stage},
};

/// A stack with its profile, as it was taken or with a fault.
#[derive(Clone)]
struct Stack {
    slices: Vec<Raster>,
    plan: Plan,
    object: Plane<u8>,
}

impl Stack {
    fn of(rig: &Rig, scene: &Scene) -> Self {
        let stage = Stage::new(rig, scene);
        let mut plan = Plan::aligned(rig.width, rig.height, rig.slices());
        plan.reference = rig.reference;
        for i in 0..rig.slices() {
            (plan.homographies[i], plan.gains[i]) = (rig.homography(i), rig.gain(i));
        }
        let slices = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
        Self { slices, plan, object: stage.truth().mask }
    }

    fn count(&self) -> usize {
        self.slices.len()
    }

    fn fused(&self, masked: bool) -> Fused {
        let watch = Watch { metrics: true, object: masked.then_some(&self.object) };
        fuse(&&self.slices[..], &self.plan, &watch, &std::env::temp_dir(), &Unwatched).unwrap()
    }

    fn findings(&self, masked: bool) -> Vec<Finding> {
        self.fused(masked).quality.unwrap().findings
    }

    /// The same with these slices alone, and a profile of them alone.
    fn only(mut self, keep: impl Fn(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.count()).filter(|&n| keep(n)).collect();
        let pick = |n: &usize| self.slices[*n].clone();
        self.slices = kept.iter().map(pick).collect();
        self.plan.homographies = kept.iter().map(|&n| self.plan.homographies[n]).collect();
        self.plan.gains = kept.iter().map(|&n| self.plan.gains[n]).collect();
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

    /// Samples of a slice multiplied, by channel.
    fn lit(mut self, slice: usize, by: [f32; 3]) -> Self {
        let Samples::Eight(samples) = &mut self.slices[slice].samples else { panic!("8 bits expected") };
        for pixel in samples.chunks_exact_mut(3) {
            pixel
                .iter_mut()
                .zip(by)
                .for_each(|(sample, by)| *sample = (f32::from(*sample) * by).round().min(255.0) as u8);
        }
        self
    }

    /// Each slice's homography followed by a similarity about the middle of the picture.
    fn profiled(mut self, left: impl Fn(f64) -> (f64, [f64; 2])) -> Self {
        let middle = [(self.plan.width as f64 - 1.0) / 2.0, (self.plan.height as f64 - 1.0) / 2.0];
        for n in 0..self.count() {
            let (scale, shift) = left(n as f64);
            let shift = [0, 1].map(|axis: usize| middle[axis] * (1.0 - scale) + shift[axis]);
            let moved = self.plan.homographies[n].then(&Homography::similarity(scale, shift)).unwrap();
            self.plan.homographies[n] = moved;
        }
        self
    }
}

type Fault = (&'static str, fn(Stack) -> Stack);

const FAULTS: [Fault; 14] = [
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
        stack.lit(n / 2 + 1, [0.93; 3])
    }),
    ("white_balance_drift", |stack| {
        let n = stack.count();
        stack.lit(n / 2 - 1, [1.04, 0.985, 1.0])
    }),
    ("exposure_drift", |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| s.lit(i, [1.0 - 0.2 * i as f32 / n as f32; 3]))
    }),
    ("slice_misaligned", |stack| {
        let n = stack.count() / 2;
        stack.profiled(|i| (1.0, if i == n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("picture_jumps", |stack| {
        let n = stack.count() / 2;
        stack.profiled(|i| (1.0, if i >= n as f64 { [2.0, -1.0] } else { [0.0; 2] }))
    }),
    ("profile_misfit", |stack| {
        let n = stack.count() as f64;
        stack.profiled(|i| (1.0 + 0.012 * (i / n - 0.5), [0.0; 2]))
    }),
    ("clipped", |stack| (0..stack.count()).fold(stack, |s, i| s.lit(i, [2.4; 3]))),
];

/// Codes of the warnings of a stack.
fn warned(stack: &Stack, masked: bool) -> Vec<String> {
    let findings = stack.findings(masked).into_iter();
    findings.filter(|finding| finding.severity == Severity::Warning).map(|finding| finding.code).collect()
}

/// `but` are faults that this scene cannot show.
fn each_fault_alone(rig: &Rig, scene: &Scene, but: &[&str]) {
    let clean = Stack::of(rig, scene);
    let wrong: Vec<String> = FAULTS
        .par_iter()
        .filter(|(fault, _)| !but.contains(fault))
        .filter_map(|(fault, make)| {
            let expected: Vec<&str> = if fault.is_empty() { Vec::new() } else { vec![fault] };
            let found = warned(&make(clean.clone()), true);
            (found != expected).then(|| format!("{expected:?} was told as {found:?}"))
        })
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn each_fault_is_named_alone_on_an_insect() {
    // one slice of so fine a step may be missing without loss
    let but = ["uneven_step", "exposure_drift"];
    each_fault_alone(&Rig::sized(480, 360, 11), &Scene::insect(1), &but);
    each_fault_alone(&Rig { seed: 2, ..Rig::sized(640, 440, 9) }, &Scene::insect(2), &["exposure_drift"]);
}

#[test]
fn each_fault_is_named_alone_on_a_flower() {
    // little of it lies near, and none of it is bright
    let but = ["uneven_step", "exposure_drift", "range_too_short_near", "clipped"];
    each_fault_alone(&Rig::sized(480, 360, 11), &Scene::flower(1), &but);
}

/// For `docs/METRICS.md`: what is named on which stack.
#[test]
#[ignore = "a table for the documentation, minutes long: --ignored --nocapture"]
fn what_is_named_on_many_stacks() {
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
        let name = ["insect", "flower", "plates"][scene];
        let scene = [Scene::insect, Scene::flower, Scene::plates][scene](seed);
        let clean = Stack::of(&rig, &scene);
        for masked in [true, false] {
            let lines: Vec<String> = FAULTS.par_iter().map(|(fault, make)| {
                let quality = make(clean.clone()).fused(masked).quality.unwrap();
                let codes: Vec<String> = quality.findings.iter().map(|f| format!("{}{}{:?}", if f.severity == Severity::Note { "~" } else { "" }, f.code, f.slices)).collect();
                let s = quality.alignment.similarity;
                format!("{name} {width}x{height}x{count} masked {masked} [{fault}]: {} | drift {:.2}+-{:.2} n {} p95 {:.2} | peak {:.3} {:.3} label {:.3} amb {:.3} tex {:.2} over {:.4} {:.3} clip {:.4} common {:.3}", codes.join(" "),
                    s.map_or(-1.0, |s| s.corner_drift_px), s.map_or(-1.0, |s| s.corner_drift_sigma_px), s.map_or(0, |s| s.shifts), quality.alignment.residual_p95_px.unwrap_or(-1.0),
                    quality.focus.peak_at_first_fraction.unwrap_or(-1.0), quality.focus.peak_at_last_fraction.unwrap_or(-1.0), quality.focus.label_noise.unwrap_or(-1.0), quality.focus.ambiguity.unwrap_or(-1.0), quality.focus.textured_fraction.unwrap_or(-1.0), quality.fusion.overshoot_fraction.unwrap_or(-1.0), quality.fusion.overshoot_levels.unwrap_or(-1.0), quality.fusion.clipped_fraction.unwrap_or(-1.0), quality.alignment.common_fraction.unwrap_or(-1.0))
            }).collect();
            lines.iter().for_each(|line| println!("{line}"));
        }
    });
}

/// Real stacks beside the repository, as far as they are there: what is said of them.
#[test]
#[ignore = "needs pictures that are not in the repository: --ignored --nocapture"]
fn what_is_said_of_real_stacks() {
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
                let picture = image::open(file).unwrap().into_rgb8();
                Raster::eight(picture.width() as usize, picture.height() as usize, 3, picture.into_raw())
            })
            .collect();
        let plan = Plan::aligned(slices[0].width, slices[0].height, slices.len());
        let watch = Watch { metrics: true, object: None };
        let quality = fuse(&&slices[..], &plan, &watch, &std::env::temp_dir(), &Unwatched).unwrap().quality.unwrap();
        println!("{name}\n{:#?}\n{:?}\n{:?}\n{:?}", quality.findings, quality.fusion, quality.focus, quality.alignment);
    }
}
