//! Replays the corpus of the fuzzer with the same checks, on stable Rust.

use std::{
    fs,
    path::Path,
    time::{Duration, Instant},
};

use crate::targets::{TARGETS, Target, run};

fn corpus(target: &Target) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hostile/corpus").join(target.corpus);
    let mut inputs = (target.seeds)();
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.expect("the corpus can be read").path();
        let name = path.file_name().expect("a file").to_string_lossy().into_owned();
        inputs.push((name, fs::read(path).expect("the corpus can be read")));
    }
    inputs
}

/// Runs every input of a target and reports those that fail.
fn replay(name: &str) {
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target of this name");
    let inputs = corpus(target);
    let falls = |bytes: &[u8]| std::panic::catch_unwind(|| run(target.body, bytes)).is_err();
    let fallen: Vec<&str> = inputs.iter().filter(|(_, bytes)| falls(bytes)).map(|(input, _)| input.as_str()).collect();
    assert!(fallen.is_empty(), "{name} does not stand: {}", fallen.join(", "));
    assert!(!inputs.is_empty(), "{name} has nothing to begin with");
}

#[test]
fn the_archive_corpus_passes() {
    replay("archive");
}

#[test]
fn the_manifest_corpus_passes() {
    replay("manifest");
}

#[test]
fn the_scan_corpus_passes() {
    replay("scan");
}

#[test]
fn the_name_corpus_passes() {
    replay("names");
}

#[test]
fn the_pose_corpus_passes() {
    replay("poses");
}

/// Variations of the seeds: bytes are changed, repeated, moved and cut out.
#[test]
fn random_names_and_poses_and_scans_pass() {
    // xorshift: the same inputs in every run
    let mut state = 0xD1B5_4A32_D192_ED03_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    for (name, count) in [("names", 3_000), ("poses", 3_000), ("scan", 300)] {
        let target = TARGETS.iter().find(|target| target.name == name).expect("the target");
        let seeds = (target.seeds)();
        for _ in 0..count {
            let mut input = seeds[random() as usize % seeds.len()].1.clone();
            for _ in 0..=random() % 6 {
                let (at, to) = (random() as usize % input.len(), random() as usize % input.len());
                let (from, end) = (at.min(to), (at.max(to) + 1).min(at.min(to) + 40));
                match random() % 4 {
                    0 => input[at] = random() as u8,
                    1 => input[at] = b"0123456789_/-.=\n"[random() as usize % 16],
                    2 => drop(input.splice(to..to, input[from..end].to_vec()).count()),
                    _ if input.len() > 50 => drop(input.drain(from..end)),
                    _ => {}
                }
            }
            let fell = std::panic::catch_unwind(|| run(target.body, &input)).is_err();
            assert!(!fell, "{name} does not stand {:?}", String::from_utf8_lossy(&input));
        }
    }
}

#[test]
fn the_picture_header_corpus_passes() {
    replay("header");
}

#[test]
fn the_picture_corpus_passes() {
    replay("decode");
}

#[test]
fn the_warp_corpus_passes() {
    replay("warp");
}

/// Random mutations of the seeds, for one or two seconds, or for `PINSTACK_WARP_MINUTES` minutes.
#[test]
fn random_warps_pass() {
    let target = TARGETS.iter().find(|target| target.name == "warp").expect("the target");
    let minutes: u64 = std::env::var("PINSTACK_WARP_MINUTES").ok().and_then(|m| m.parse().ok()).unwrap_or(0);
    let end = Instant::now() + Duration::from_secs(60 * minutes);
    let seeds = (target.seeds)();
    // xorshift: the same inputs in every run
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut count = 0_u64;
    while count < 3_000 || Instant::now() < end {
        let mut input = seeds[random() as usize % seeds.len()].1.clone();
        for _ in 0..random() % 12 {
            let at = random() as usize % input.len();
            input[at] = random() as u8;
        }
        let fell = std::panic::catch_unwind(|| run(target.body, &input)).is_err();
        assert!(!fell, "warp does not stand {input:?}");
        count += 1;
    }
    if minutes > 0 {
        println!("{count} warps in {minutes} minutes");
    }
}

#[test]
fn the_profile_corpus_passes() {
    replay("profile");
}

#[test]
fn the_numpy_corpus_passes() {
    replay("numpy");
}

#[test]
fn the_options_corpus_passes() {
    replay("options");
}

#[test]
fn the_resumable_upload_corpus_passes() {
    replay("tus");
}

#[test]
fn the_form_corpus_passes() {
    replay("multipart");
}

fn group(names: &[u8]) -> pinstack_science::archive::scan::NameGrouping {
    let names: Vec<String> = String::from_utf8_lossy(names).lines().map(str::to_owned).collect();
    pinstack_science::archive::scan::group_names(&names, None, &Default::default()).expect("a grouping")
}

#[test]
fn valid_seeds_are_accepted() {
    use pinstack_science::{archive, imaging::codec};
    for target in &TARGETS {
        for (name, bytes) in (target.seeds)() {
            let is_taken = match target.name {
                "archive" => archive::open_in_memory(bytes, &crate::targets::limits()).is_ok(),
                "poses" => pinstack_science::photogrammetry::poses::read(&bytes, None).is_ok(),
                "names" => !group(&bytes).views.is_empty(),
                "scan" => {
                    let file = tempfile::NamedTempFile::new().expect("a file");
                    fs::write(file.path(), &bytes).expect("a file");
                    archive::scan::open_scan(file.path(), &crate::targets::limits(), &Default::default()).is_ok()
                }
                "decode" => codec::decode(&bytes, &crate::targets::limits().image).is_ok(),
                _ => continue,
            };
            assert!(is_taken, "{}: {name}", target.name);
        }
    }
}

#[test]
fn the_kept_corpus_stays_small() {
    fn bytes(folder: &Path) -> u64 {
        let entries =
            fs::read_dir(folder).expect("the corpus can be read").map(|entry| entry.expect("an entry").path());
        entries.map(|path| if path.is_dir() { bytes(&path) } else { path.metadata().expect("a file").len() }).sum()
    }
    let all = bytes(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hostile/corpus"));
    assert!(all < 2 << 20, "{all} bytes");
}
