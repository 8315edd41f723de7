//! Fusion quality: synthetic stacks with known truth, fused by every method and by the other programs that are
//! installed.
//!
//! `cargo bench --bench fusion_quality -- [--quick] [--scene NAME] [--softness PX] [--blur TIMES] [--crops FOLDER]`
//! prints tables of PSNR; `-- --edges FILE ...` prints the softness of the edges of the scenes and of image files
//! instead.
//!
//! The other programs are `enfuse`, if it is on the path, and shinestacker, if the environment variable
//! PINSTACK_SHINESTACKER names a Python interpreter that can import it. All get the same slices, warped by the true
//! homographies.

#[path = "common/fusion_quality/mod.rs"]
mod fusion_quality;

use std::{fs, path::PathBuf};

use fusion_quality::{Case, Crop, Peers, Regions, Scores, Table, spreads, worst};
use pinstack_science::{
    imaging::{Raster, codec},
    synth::scene::SCENES,
    types::fusion_options::Method,
};

const METHODS: [(&str, Method); 3] =
    [("guided", Method::Guided), ("pyramid", Method::Pyramid), ("halo_corrected", Method::HaloCorrected)];

/// Softness of the lens (standard deviation of a Gaussian), px: the sharpest edges of the scenes are then as sharp as
/// the sharpest hundredth of the edges in photographs.
const SOFTNESS: f64 = 0.7;

struct Arguments {
    quick: bool,
    scene: Option<String>,
    softness: f64,
    /// Factor on the blur per step of all stacks.
    blur: f64,
    crops: Option<PathBuf>,
    /// Image files whose edges are measured instead of fusing anything.
    edges: Option<Vec<PathBuf>>,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments { quick: false, scene: None, softness: SOFTNESS, blur: 1.0, crops: None, edges: None };
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            // added by `cargo bench`
            "--bench" => {}
            "--quick" => found.quick = true,
            "--scene" => found.scene = Some(value()?),
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
            other => {
                return Err(format!(
                    "unknown argument {other}; use --quick, --scene NAME, --softness PX, --blur TIMES, --crops FOLDER, --edges FILE ..."
                ));
            }
        }
    }
    Ok(found)
}

/// Seven stacks of a scene: three seeds in two sizes, and one small stack with more blur. With `--quick` the first
/// alone.
fn cases(arguments: &Arguments, scene: &'static str, make: fn(u64) -> pinstack_science::synth::Scene) -> Vec<Case> {
    let case =
        |seed, size, blur| Case { scene, make, seed, size, blur: blur * arguments.blur, softness: arguments.softness };
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
        let case = Case { scene, make, seed: 1, size: (1200, 800), blur: 1.0, softness: arguments.softness };
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
    let peers = Peers::detect();
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
            for (name, method) in METHODS {
                pictures.push((name, true, stack.fuse(method).image));
            }
            pictures.extend(peers.fuse(&stack.warped()).into_iter().map(|(name, picture)| (name, false, picture)));
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
                let ours = pictures.iter().filter(|picture| picture.1);
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
