//! Tables of findings and metrics, for `docs/FINDINGS.md`.

use rayon::prelude::*;

use super::{
    drifting,
    faulty_stack::{FAULTS, Stack},
    warning_codes,
};
use crate::{
    quality::StackQuality,
    synth::{Rig, scene::SCENES},
    types::metrics::Severity,
};

/// Prints how often `exposure_drift` is reported, by scene and drift: the figures for that finding in
/// `docs/FINDINGS.md`.
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

/// Prints the findings and the main metrics of stacks with each fault: the figures on findings in `docs/FINDINGS.md`.
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
