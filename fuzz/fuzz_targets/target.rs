//! One fuzzer for every target: `PINSTACK_FUZZ_TARGET` names the one that is run.
#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use pinstack_fuzz::targets::{TARGETS, run, watch_panics};

static BODY: OnceLock<fn(&[u8])> = OnceLock::new();

fn choose() {
    let wanted = std::env::var("PINSTACK_FUZZ_TARGET").unwrap_or_default();
    let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    let found = TARGETS.iter().find(|target| target.name == wanted);
    let target = found.unwrap_or_else(|| panic!("PINSTACK_FUZZ_TARGET must be one of {}", names.join(", ")));
    if let Ok(folder) = std::env::var("PINSTACK_FUZZ_SEEDS") {
        for (name, bytes) in (target.seeds)() {
            std::fs::write(std::path::Path::new(&folder).join(format!("seed-{name}")), bytes).expect("a seed");
        }
    }
    let _ = BODY.set(target.body);
    // instead of the hook that ends the process at every panic: those of decoders are caught on purpose
    let _ = std::panic::take_hook();
    watch_panics();
}

fuzz_target!(init: choose(), |input: &[u8]| {
    if let Some(body) = BODY.get() {
        run(*body, input);
    }
});
