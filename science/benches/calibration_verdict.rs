//! The verdict of the calibration against the truth, on synthetic stacks with faults. `cargo bench --bench
//! calibration_verdict -- [--quick] [--only NAME;NAME] [--seeds N] [--offset N]`
//!
//! Each fault alone at several strengths, stacks without a fault, and random mixtures. A stack whose verdict is "Good"
//! and wrong, a stack that was downgraded or refused without need, and a gain that is off and not told are one line
//! each; the table at the end counts them per family.

#[path = "common/verdict/mod.rs"]
mod verdict;

use pinstack_science::types::report::Grade;
use rayon::prelude::*;
use verdict::{Judgement, Selection, judge, stacks, table};

fn main() {
    let mut selection = Selection { seeds: 6, mixtures: 108, offset: 0, only: Vec::new() };
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut number = || rest.next().and_then(|text| text.parse().ok()).unwrap_or_else(|| usage(&argument));
        match argument.as_str() {
            // an argument that `cargo bench` adds
            "--bench" => {}
            "--quick" => (selection.seeds, selection.mixtures) = (1, 10),
            "--only" => {
                let names = rest.next().unwrap_or_else(|| usage(&argument));
                selection.only = names.split(';').map(str::to_owned).collect();
            }
            "--seeds" => selection.seeds = number(),
            "--offset" => selection.offset = number(),
            other => usage(other),
        }
    }
    let stacks = stacks(&selection);
    let judgements: Vec<Judgement> = stacks.par_iter().map(judge).collect();
    for of in &judgements {
        let verdict = match of.grade {
            Some(Grade::Good) if of.wrong || of.dishonest => "GOOD AND WRONG",
            None if of.downgraded => "refused without need",
            Some(_) if of.downgraded => "downgraded without need",
            Some(_) if of.gain_untold => "gain not told",
            _ => continue,
        };
        println!("{verdict}: {}: corner {:.2} px, gain {:.2} %: {}", of.what, of.corner, 100.0 * of.gain, of.told);
    }
    println!("\n{}", table(&judgements));
}

fn usage<T>(argument: &str) -> T {
    eprintln!("{argument} is not understood: --quick, --only NAME;NAME, --seeds N, --offset N");
    std::process::exit(2)
}
