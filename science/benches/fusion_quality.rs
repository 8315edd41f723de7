//! Fusion quality: synthetic stacks with known truth, fused by every method and by the other programs that are
//! installed.
//!
//! `cargo bench --bench fusion_quality -- [--quick] [--scene NAME] [--method NAME] [--softness PX] [--blur TIMES]
//! [--unknown-near-end] [--crops FOLDER]` prints tables of PSNR; `-- --edges FILE ...` prints the softness of the edges
//! of the scenes and of image files instead, and `-- --photographs FOLDER ...` the metrics of stacks of photographs,
//! fused as if they were aligned.
//!
//! The row "true decision map" is `halo_corrected` with the true slice of each pixel of the object. It tells how much a
//! better decision map can gain.
//!
//! The other programs are `enfuse`, if it is on the path, and shinestacker, if the environment variable
//! PINSTACK_SHINESTACKER names a Python interpreter that can import it. All get the same slices, warped by the true
//! homographies.

#[path = "common/fusion_quality/mod.rs"]
mod fusion_quality;

use std::{
    fs,
    path::{Path, PathBuf},
};

use fusion_quality::{Case, Crop, Peers, Regions, Scores, Table, spreads, worst};
use pinstack_science::{
    fusion::{FusionRequest, Plan, fuse},
    imaging::{Raster, codec},
    quality::StackQuality,
    synth::scene::SCENES,
    types::{NoControl, fusion_options::Method},
};

/// The row of the default method with the true decision map.
const BY_TRUTH: &str = "true decision map";

/// Softness of the lens (standard deviation of a Gaussian), px: the sharpest edges of the scenes are then as sharp as
/// the sharpest hundredth of the edges in photographs.
const SOFTNESS: f64 = 0.7;

struct Arguments {
    quick: bool,
    scene: Option<String>,
    /// The only method to run, instead of all methods, the true decision map and the other programs.
    method: Option<String>,
    /// Whether the methods are told which end of the stack is near.
    near_end_known: bool,
    softness: f64,
    /// Factor on the blur per step of all stacks.
    blur: f64,
    crops: Option<PathBuf>,
    /// Image files whose edges are measured instead of fusing anything.
    edges: Option<Vec<PathBuf>>,
    /// Folders with the slices of real stacks, which have no truth.
    photographs: Vec<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments {
        quick: false,
        scene: None,
        method: None,
        near_end_known: true,
        softness: SOFTNESS,
        blur: 1.0,
        crops: None,
        edges: None,
        photographs: Vec::new(),
    };
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            // added by `cargo bench`
            "--bench" => {}
            "--quick" => found.quick = true,
            "--scene" => found.scene = Some(value()?),
            "--method" => {
                let value = value()?;
                let known = Method::ALL.iter().any(|method| method.name() == value) || value == BY_TRUTH;
                found.method = Some(known.then_some(value.clone()).ok_or(format!("--method {value}: no such method"))?);
            }
            "--unknown-near-end" => found.near_end_known = false,
            "--softness" => {
                let value = value()?;
                let softness = value.parse().ok().filter(|softness| (0.0..=4.0).contains(softness));
                found.softness = softness.ok_or(format!("--softness {value}: give 0 to 4 px"))?;
            }
            "--blur" => {
                let value = value()?;
                let blur = value.parse().ok().filter(|blur| (0.1..=8.0).contains(blur));
                found.blur = blur.ok_or(format!("--blur {value}: give 0.1 to 8 times"))?;
            }
            "--crops" => found.crops = Some(value()?.into()),
            "--edges" => {
                found.edges = Some(rest.by_ref().filter(|file| file != "--bench").map(PathBuf::from).collect())
            }
            "--photographs" => {
                found.photographs = rest.by_ref().filter(|folder| folder != "--bench").map(PathBuf::from).collect()
            }
            other => {
                return Err(format!(
                    "unknown argument {other}; use --quick, --scene NAME, --method NAME, --softness PX, --blur TIMES, \
                     --unknown-near-end, --crops FOLDER, --edges FILE ..., --photographs FOLDER ..."
                ));
            }
        }
    }
    Ok(found)
}

/// Seven stacks of a scene: three seeds in two sizes, and one small stack with more blur. With `--quick` the first
/// alone.
fn cases(arguments: &Arguments, scene: &'static str, make: fn(u64) -> pinstack_science::synth::Scene) -> Vec<Case> {
    let (softness, near_end_known) = (arguments.softness, arguments.near_end_known);
    let case =
        |seed, size, blur: f64| Case { scene, make, seed, size, blur: blur * arguments.blur, softness, near_end_known };
    let (small, large) = ((600, 400), (1200, 800));
    if arguments.quick {
        return vec![case(1, small, 1.0)];
    }
    let plain = [small, large].into_iter().flat_map(|size| (1..=3).map(move |seed| case(seed, size, 1.0)));
    plain.chain([case(1, small, 1.5)]).collect()
}

/// Prints the softness of the edges of the scenes, with everything in focus, and of `files`.
fn print_edges(arguments: &Arguments, files: &[PathBuf]) {
    println!("| edges, standard deviation in px | edges | softest of the sharpest 1 % | 5 % | median |");
    println!("|---|---:|---:|---:|---:|");
    let print = |name: &str, spreads: &[f32]| {
        let at = |share: f64| spreads.get((spreads.len() as f64 * share) as usize).map_or(f32::NAN, |spread| *spread);
        println!("| {name} | {} | {:.2} | {:.2} | {:.2} |", spreads.len(), at(0.01), at(0.05), at(0.5));
    };
    for (scene, make) in SCENES {
        let (softness, size) = (arguments.softness, (1200, 800));
        let case = Case { scene, make, seed: 1, size, blur: 1.0, softness, near_end_known: true };
        print(&format!("{scene}, softness {}", arguments.softness), &spreads(&case.render().truth.sharp));
    }
    for file in files {
        let bytes = fs::read(file).unwrap_or_else(|why| panic!("{}: {why}", file.display()));
        match codec::decode(&bytes, &codec::Limits::default()) {
            Ok(picture) => print(&file.display().to_string(), &spreads(&picture)),
            Err(why) => eprintln!("{}: {why}", file.display()),
        }
    }
}

/// Prints what each method keeps of the slices in a folder of pictures, whose names give their order.
fn print_metrics(folder: &Path) {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap_or_else(|why| panic!("{}: {why}", folder.display()))
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("jpg")))
        .collect();
    paths.sort();
    let decoded = |path: &PathBuf| codec::decode(&fs::read(path).expect("a slice"), &codec::Limits::default());
    let slices: Vec<Raster> = paths.iter().map(|path| decoded(path).expect("a picture")).collect();
    let (width, height) = slices.first().map_or((0, 0), |slice| (slice.width, slice.height));
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    for method in Method::ALL {
        let plan = Plan { method, ..Plan::aligned(width, height, slices.len()) };
        let request = FusionRequest { metrics: true, ..FusionRequest::default() };
        let fused = fuse(&&slices[..], &plan, &request, &std::env::temp_dir(), &NoControl).expect("a fused picture");
        let StackQuality { fusion: found, alignment, .. } = fused.quality.expect("the metrics were requested");
        let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |value| format!("{value:.digits$}"));
        println!(
            "| {name}, {width} x {height} px, {} slices | {} | {} | {} | {} | {} |",
            slices.len(),
            method.name(),
            number(found.q_g_top, 3),
            number(found.q_w_top, 3),
            number(found.sharpness_retention, 2),
            number(found.overshoot_levels, 2)
        );
        let drift = alignment.similarity.map(|similarity| similarity.corner_drift_px);
        eprintln!("{name}: the corners drift by {} px", number(drift, 1));
    }
}

fn main() {
    // paths in arguments are relative to the root of the project; cargo starts a bench in its crate
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).expect("the root of the project");
    let arguments = arguments().unwrap_or_else(|why| {
        eprintln!("{why}");
        std::process::exit(2)
    });
    if let Some(files) = &arguments.edges {
        return print_edges(&arguments, files);
    }
    if !arguments.photographs.is_empty() {
        println!("| real stack | method | `q_g_top` | `q_w_top` | `sharpness_retention` | `overshoot_levels` |");
        println!("|---|---|---:|---:|---:|---:|");
        return arguments.photographs.iter().for_each(|folder| print_metrics(folder));
    }
    let peers = arguments.method.is_none().then(Peers::detect);
    let mut all = Table::default();
    for (scene, make) in SCENES {
        if arguments.scene.as_ref().is_some_and(|wanted| wanted != scene) {
            continue;
        }
        let mut of_scene = Table::default();
        for (number, case) in cases(&arguments, scene, make).iter().enumerate() {
            let stack = case.render();
            let mut pictures: Vec<(&str, bool, Raster)> = Vec::new();
            let regions = Regions::of(&stack.truth, stack.covered());
            let wanted = |name: &str| arguments.method.as_ref().is_none_or(|wanted| wanted == name);
            for method in Method::ALL.into_iter().filter(|method| wanted(method.name())) {
                pictures.push((method.name(), true, stack.fuse(method).image));
            }
            if wanted(BY_TRUTH) {
                pictures.push((BY_TRUTH, true, stack.fuse_by_truth().image));
            }
            let peers = peers.iter();
            pictures.extend(
                peers.flat_map(|peers| peers.fuse(&stack.warped())).map(|(name, picture)| (name, false, picture)),
            );
            let mut best: Option<(f64, usize)> = None;
            for (at, (name, ours, picture)) in pictures.iter().enumerate() {
                let scores = Scores::of(picture, &stack.truth, &regions);
                eprintln!("{:28} {name:24} {}", case.name(), scores.0.map(|v| format!("{v:6.2}")).join(" "));
                of_scene.enter(name, *ours, scores);
                all.enter(name, *ours, scores);
                if !ours && best.is_none_or(|(edges, _)| scores.0[3] > edges) {
                    best = Some((scores.0[3], at));
                }
            }
            if let Some(folder) = arguments.crops.as_ref().filter(|_| number == 0) {
                let ours = pictures.iter().filter(|picture| picture.1 && picture.0 != BY_TRUTH);
                let shown = best.map(|(_, at)| &pictures[at]).into_iter().chain(ours);
                let beside: Vec<&Raster> =
                    std::iter::once(&stack.truth.sharp).chain(shown.map(|picture| &picture.2)).collect();
                let crop = Crop::of(&beside, worst(&pictures[0].2, &stack.truth.sharp));
                fs::create_dir_all(folder).expect("the folder for the crops can be made");
                fs::write(folder.join(format!("{scene}.jpg")), crop.jpeg()).expect("a crop can be written");
            }
        }
        of_scene.print(scene);
    }
    all.print("All scenes");
}
