//! Accuracy of the calibration on many synthetic stacks of the dot target with known truth and various defects. `cargo
//! bench --bench calibration_sweep -- [--quick] [--cases N] [--seed S] [--csv FILE]`
//!
//! One block varies each factor alone around a typical case, another draws all factors at random. Each case is one
//! line. The tables at the end serve to compare two versions.

#[path = "common/sweep/mod.rs"]
mod sweep;

use std::{io::Write, path::PathBuf, time::Instant};

use rayon::prelude::*;
use sweep::{Case, Outcome, cases, judge, tables};

struct Arguments {
    quick: bool,
    random: usize,
    seed: u64,
    csv: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments { quick: false, random: 60, seed: 1, csv: None };
    let mut random = None;
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            // an argument that `cargo bench` adds
            "--bench" => {}
            "--quick" => found.quick = true,
            "--cases" => random = Some(value()?.parse().map_err(|_| "--cases needs a number")?),
            "--seed" => found.seed = value()?.parse().map_err(|_| "--seed needs a number")?,
            "--csv" => found.csv = Some(value()?.into()),
            other => return Err(format!("{other} is not known: --quick, --cases N, --seed S, --csv FILE")),
        }
    }
    found.random = random.unwrap_or(if found.quick { 12 } else { 60 });
    Ok(found)
}

fn main() {
    // paths in arguments are relative to the root of the project; cargo starts a bench in its crate
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).expect("the root of the project");
    let arguments = arguments().unwrap_or_else(|why| {
        eprintln!("{why}");
        std::process::exit(2)
    });
    let seeds = if arguments.quick { 1 } else { 3 };
    let cases: Vec<Case> = cases(seeds, arguments.random, arguments.seed);
    let started = Instant::now();
    let mut outcomes: Vec<Outcome> = Vec::new();
    println!("{}", Outcome::HEADER);
    // in chunks: results are printed in order, and few stacks are in memory at a time
    for few in cases.chunks(8) {
        let done: Vec<Outcome> = few.par_iter().map(judge).collect();
        done.iter().for_each(|outcome| println!("{outcome}"));
        outcomes.extend(done);
    }
    println!("\n{}", tables(&outcomes));
    println!("{} cases in {:.0} s", outcomes.len(), started.elapsed().as_secs_f64());
    if let Some(path) = arguments.csv {
        let mut text = format!("{}\n", Outcome::CSV_HEADER);
        outcomes.iter().for_each(|outcome| text.push_str(&outcome.csv()));
        let written = std::fs::File::create(&path).and_then(|mut file| file.write_all(text.as_bytes()));
        if let Err(why) = written {
            eprintln!("{} cannot be written: {why}", path.display());
            std::process::exit(1);
        }
    }
}
