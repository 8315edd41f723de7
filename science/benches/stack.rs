//! What fusing a stack costs, stage by stage, beside what decoding its slices costs alone: `cargo bench --bench stack
//! -- [--quick | --large] [--only NAME] [--slices N] [--threads N] [--no-enfuse] [--zip FILE] [--photographs FOLDER]`.
//! `--quick` leaves out the large pictures, `--large` the small ones, `--only` all but one of `typical`, `dense` and
//! `sixteen`; `--zip` measures a stack of your own instead, one light, as if its slices were aligned and the first in
//! focus nearest to the camera. `--photographs FOLDER` measures the photographed stacks in the folder, or that of
//! `--only`, aligned by profiles that are stored beside this bench.
//! `METHOD=NAME` in the environment says by which method slices are fused.
//!
//! Each row of the table is a process of its own, so that its peak of memory is its own. CPU time counts, not wall
//! time, because others may be using the machine; the ratio to the decoder in the same run is the figure to watch.
//! Files come from the disk's cache. `enfuse` is shown beside it where it is installed: it gets the warped slices as
//! TIFF files, so that it does only what the two passes do.

#[path = "common/stack/mod.rs"]
mod stack;

use std::{
    env, fs,
    io::Write,
    path::Path,
    process::{Command, Stdio},
};

use stack::{Case, Cost, FRONT, Kind, OF_BACK, PHOTOGRAPHED, RENDERED, STAGES, enfuse, make, packed, stage};

const LARGE: (usize, usize) = (6000, 4000);

/// Runs a stage in a child, and reads its cost.
fn cost(name: &str, case: Case, folder: &Path, threads: usize) -> Cost {
    let output = Command::new(env::current_exe().expect("our own path"))
        .args(["--stage", name, folder.to_str().expect("a path in UTF-8")])
        .args(case.words())
        .env("RAYON_NUM_THREADS", threads.to_string())
        .stderr(Stdio::inherit())
        .output()
        .expect("a child");
    assert!(output.status.success(), "{name} of {} failed", case.name());
    let words = String::from_utf8(output.stdout).expect("numbers");
    let numbers: Vec<f64> = words.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    Cost { cpu: numbers[0], wall: numbers[1], peak_mb: Some(numbers[2]).filter(|mb| *mb > 0.0) }
}

fn line(name: &str, cost: Cost, decode: Option<Cost>, pixels: f64) {
    let ratio = decode.map_or(String::new(), |decode| format!("{:.2}", cost.cpu / decode.cpu));
    let peak = cost.peak_mb.map_or(String::new(), |mb| format!("{mb:.0}"));
    let each = cost.cpu * 1e9 / pixels;
    println!("| {name:<17} | {:>8.3} | {:>8.3} | {each:>7.2} | {ratio:>8} | {peak:>7} |", cost.cpu, cost.wall);
    std::io::stdout().flush().expect("someone reads");
}

fn main() {
    let arguments: Vec<String> = env::args().skip(1).filter(|word| word != "--bench").collect();
    if let [flag, name, folder, case @ ..] = arguments.as_slice()
        && flag == "--stage"
    {
        let cost = stage(name, Case::of(case), Path::new(folder));
        println!("{} {} {}", cost.cpu, cost.wall, cost.peak_mb.unwrap_or(0.0));
        return;
    }
    let has = |flag: &str| arguments.iter().any(|word| word == flag);
    let word = |flag: &str| arguments.get(arguments.iter().position(|word| word == flag)? + 1);
    let number = |flag: &str, otherwise: usize| word(flag).and_then(|word| word.parse().ok()).unwrap_or(otherwise);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (slices, threads) = (number("--slices", 10), number("--threads", cores));
    let sizes = match (has("--quick"), has("--large")) {
        (true, _) => vec![RENDERED],
        (_, true) => vec![LARGE],
        _ => vec![RENDERED, LARGE],
    };

    println!("{threads} threads; CPU and wall time in s, CPU time per pixel of all slices, peak memory in MB");
    let table = |case: Case, folder: &Path| {
        let zip = fs::metadata(folder.join(FRONT)).expect("the zip").len() as f64;
        println!("\n{} ({:.1} MB per slice)", case.name(), zip / 1e6 / case.slices as f64);
        println!("| stage             |      CPU |     wall |   ns/px | x decode | peak MB |");
        println!("|-------------------|---------:|---------:|--------:|---------:|--------:|");
        let pixels = (case.width * case.height * case.slices) as f64;
        let mut decode = None;
        for name in STAGES.into_iter().filter(|name| case.has_back() || !OF_BACK.contains(name)) {
            let cost = cost(name, case, folder, threads);
            let decode = *decode.get_or_insert(cost);
            line(name, cost, Some(decode), pixels);
        }
        if !has("--no-enfuse")
            && let Some(cost) = enfuse(case, folder)
        {
            line("enfuse", cost, decode, pixels);
        }
    };
    let folder = || tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    if let Some(own) = word("--zip") {
        let folder = folder();
        fs::copy(own, folder.path().join(FRONT)).unwrap_or_else(|why| panic!("{own}: {why}"));
        return table(Case::of_own(Path::new(own)), folder.path());
    }
    if let Some(photographs) = word("--photographs") {
        for (stack, (name, _)) in PHOTOGRAPHED.into_iter().enumerate() {
            if word("--only").is_none_or(|only| only == name) {
                let (case, folder) = (Case::photographed(stack), folder());
                let complete = packed(case, &Path::new(photographs).join(name), folder.path());
                assert!(complete, "{photographs}/{name} does not have the {} slices of its profile", case.slices);
                table(case, folder.path());
            }
        }
        return;
    }
    for (width, height) in sizes {
        let kinds =
            [("typical", Kind::Typical, false), ("dense", Kind::Dense, false), ("sixteen", Kind::Typical, true)];
        for (name, kind, sixteen) in kinds {
            if word("--only").is_none_or(|only| only == name) {
                let (case, folder) = (Case { kind, width, height, sixteen, slices }, folder());
                make(case, folder.path());
                table(case, folder.path());
            }
        }
    }
}
