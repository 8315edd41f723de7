//! The pictures of docs/TROUBLESHOOTING.md: rendered stacks, each fused without and with a fault.
//!
//! `cargo run --example fault_pictures -- docs/troubleshooting` writes them to that folder. Each stack must
//! be reported with the code that stands beside it; otherwise the program fails.

mod picture;
mod silhouette;
mod stack;

use std::{fs, path::PathBuf, process::ExitCode};

use pinstack_science::{
    fusion::Fused,
    imaging::{Raster, codec},
    synth::{Rig, Scene},
    types::fusion_options::Method,
};

use picture::{Part, beside, shown};
use silhouette::{OF_MASKS, silhouette};
use stack::Stack;

/// Largest file, bytes.
const LARGEST: usize = 40_000;
const QUALITY: u8 = 82;

/// A fault, its code and what of the image shows it.
struct Case {
    code: &'static str,
    scene: fn(u64) -> Scene,
    part: Part,
    make: fn(Stack) -> Stack,
    /// The code that the stack is reported with, if it is.
    reported_as: Option<&'static str>,
}

const fn case(code: &'static str, scene: fn(u64) -> Scene, part: Part, make: fn(Stack) -> Stack) -> Case {
    Case { code, scene, part, make, reported_as: Some(code) }
}

const CASES: [Case; 12] = [
    case("range_too_short_near", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i >= n / 2)
    }),
    case("range_too_short_far", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2)
    }),
    case("coverage_gap", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.only(|i| i < n / 2 - 2 || i > n / 2 + 2)
    }),
    case("slices_out_of_order", Scene::insect, Part::Enlarged(2), |stack| {
        let n = stack.count();
        stack.swapped(n / 2 - 2, n / 2 + 2)
    }),
    case("slices_reversed", Scene::insect, Part::Enlarged(2), |mut stack| {
        stack.slices.reverse();
        stack
    }),
    case("profile_misfit", Scene::insect, Part::Enlarged(3), |stack| {
        let n = stack.count() as f64;
        stack.with_profile_error(|i| (1.0 + 0.05 * (i / n - 0.5), [0.0; 2]))
    }),
    case("slice_misaligned", Scene::insect, Part::Enlarged(3), |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i == n as f64 { [4.0, -2.0] } else { [0.0; 2] }))
    }),
    case("picture_jumps", Scene::insect, Part::Enlarged(3), |stack| {
        let n = stack.count() / 2;
        stack.with_profile_error(|i| (1.0, if i >= n as f64 { [4.0, -2.0] } else { [0.0; 2] }))
    }),
    case("exposure_drift", Scene::insect, Part::Whole, |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| s.scaled(i, [1.0 - 0.5 * i as f32 / n as f32; 3]))
    }),
    case("white_balance_drift", Scene::insect, Part::Whole, |stack| {
        let n = stack.count();
        (0..n).fold(stack, |s, i| {
            let share = i as f32 / n as f32 - 0.5;
            s.scaled(i, [1.0 + 0.4 * share, 1.0, 1.0 - 0.4 * share])
        })
    }),
    case("clipped", Scene::insect, Part::Whole, |stack| (0..stack.count()).fold(stack, |s, i| s.scaled(i, [3.0; 3]))),
    // the metrics count overshoot; this halo is within the range of the slices
    Case {
        reported_as: None,
        ..case("halos", Scene::insect, Part::Enlarged(3), |mut stack| {
            stack.plan.method = Method::Guided;
            stack
        })
    },
];

fn main() -> ExitCode {
    let Some(folder) = std::env::args().nth(1).map(PathBuf::from) else {
        eprintln!("give the folder of the pictures");
        return ExitCode::FAILURE;
    };
    let mut wrong = Vec::new();
    let mut finish = |code: &str, codes: &[String], expected: Option<&str>, picture: &Raster| {
        let file = codec::encode_jpeg(picture, QUALITY);
        println!("{code}: {} bytes, reported as {codes:?}", file.len());
        if expected.is_some_and(|expected| !codes.iter().any(|found| found == expected)) {
            wrong.push(format!("{code} is not reported as {expected:?}"));
        }
        if file.len() >= LARGEST {
            wrong.push(format!("{code} has {} bytes", file.len()));
        }
        fs::write(folder.join(format!("{code}.jpg")), file).expect("written");
    };
    fs::create_dir_all(&folder).expect("a folder");
    for Case { code, scene, part, make, reported_as } in CASES {
        let clean = Stack::of(&Rig::sized(480, 360, 13), &scene(1));
        let right = clean.fused().image;
        let wrong = make(clean.clone()).fused();
        let half = |image: &Raster| shown(image, part, &right, &wrong.image);
        finish(code, &reported(&wrong), reported_as, &beside(&half(&right), &half(&wrong.image)));
    }
    for (code, expected, make) in OF_MASKS {
        let (light, cut_out, codes) = silhouette(make);
        let half = |image: &Raster| shown(image, Part::Whole, &light, &light);
        finish(code, &codes, Some(expected), &beside(&half(&light), &half(&cut_out)));
    }
    for line in &wrong {
        eprintln!("{line}");
    }
    if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// All codes that the service would show.
fn reported(fused: &Fused) -> Vec<String> {
    let findings = fused.quality.iter().flat_map(|quality| &quality.findings).map(|finding| finding.code.to_string());
    findings.chain(fused.warnings.iter().map(|warning| warning.code.to_string())).collect()
}
