//! The verdict of the calibration against the truth, on synthetic stacks with faults. `cargo bench --bench
//! calibration_verdict -- [--quick] [--only NAME;NAME] [--seeds N] [--mixtures N] [--offset
//! N]`
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
            "--mixtures" => selection.mixtures = number(),
            "--offset" => selection.offset = number(),
            other => usage(other),
        }
    }
    let stacks = stacks(&selection);
    let mut judgements: Vec<Judgement> = Vec::new();
    // in chunks: lines are printed in order, and as soon as they are known
    for few in stacks.chunks(8) {
        let few: Vec<Judgement> = few.par_iter().map(judge).collect();
        few.iter().for_each(print);
        judgements.extend(few);
    }
    println!("\n{}", table(&judgements));
}

/// One line about a judgement that is wrong in any way.
fn print(of: &Judgement) {
    let verdict = match of.grade {
        Some(Grade::Good) if of.wrong || of.dishonest => "GOOD AND WRONG",
        None if of.downgraded => "refused without need",
        Some(_) if of.downgraded => "downgraded without need",
        Some(_) if of.gain_untold => "gain not told",
        _ => return,
    };
    println!("{verdict}: {}: corner {:.2} px, gain {:.2} %: {}", of.what, of.corner, 100.0 * of.gain, of.told);
}

fn usage<T>(argument: &str) -> T {
    eprintln!("{argument} is not understood: --quick, --only NAME;NAME, --seeds N, --mixtures N, --offset N");
    std::process::exit(2)
}
