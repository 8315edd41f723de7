//! Accuracy of the height map on synthetic stacks with known truth, beside the index of the sharpest slice.
//!
//! `cargo bench --bench height -- [--quick] [--scene NAME] [--method NAME]` prints a table. `--stack FOLDER --to FILE`
//! measures the height map of a stack of aligned image files instead, and writes its shaded relief as PNG.

#[path = "common/height/mod.rs"]
mod height;

use std::path::PathBuf;

use height::{Case, Score};
use pinstack_science::{synth::scene::SCENES, types::fusion_options::Method};

#[derive(Default)]
struct Arguments {
    quick: bool,
    scene: Option<String>,
    method: Option<String>,
    stack: Option<PathBuf>,
    to: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments::default();
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            // added by `cargo bench`
            "--bench" => {}
            "--quick" => found.quick = true,
            "--scene" => found.scene = Some(value()?),
            "--method" => found.method = Some(value()?),
            "--stack" => found.stack = Some(value()?.into()),
            "--to" => found.to = Some(value()?.into()),
            other => {
                let known = "--quick, --scene NAME, --method NAME, --stack FOLDER, --to FILE";
                return Err(format!("unknown argument {other}; use {known}"));
            }
        }
    }
    Ok(found)
}

/// The stacks of a scene: (seed, slices, noise in grey levels, blur). A blur of 1 is 2 px of diameter per step with 13
/// slices. With `--quick` the first alone.
const STACKS: [(u64, usize, f64, f64); 5] =
    [(1, 13, 1.0, 1.0), (2, 13, 3.0, 1.0), (3, 25, 1.0, 1.0), (4, 7, 1.0, 1.0), (5, 13, 1.0, 2.0)];

fn main() {
    // paths in arguments are relative to the root of the project; cargo starts a bench in its crate
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).expect("the root of the project");
    let arguments = arguments().unwrap_or_else(|why| {
        eprintln!("{why}");
        std::process::exit(2)
    });
    let wanted = |method: &Method| arguments.method.as_ref().is_none_or(|wanted| wanted == method.name());
    let mut methods = Method::ALL.into_iter().filter(wanted);
    if let Some(folder) = &arguments.stack {
        let to = arguments.to.clone().unwrap_or_else(|| "relief.png".into());
        return height::relief_of(folder, &to, methods.next_back().unwrap_or_default());
    }
    println!("{}", Score::HEADER);
    for (scene, make) in SCENES.iter().filter(|(name, _)| arguments.scene.as_ref().is_none_or(|wanted| wanted == name))
    {
        for &(seed, slices, noise, blur) in &STACKS[..if arguments.quick { 1 } else { STACKS.len() }] {
            let case = Case { make: *make, seed, slices, noise, blur };
            let stack = case.render();
            for method in methods.clone() {
                let (name, score) = (method.name(), stack.score(method));
                println!("| {scene} {seed}, {slices} slices, noise {noise}, blur {blur} | {name} {score}");
            }
        }
    }
}
