//! Fuzz targets: one function per entry point of the service, with the properties that hold for any input.
//!
//! The fuzzer (`fuzz/`) calls these functions with generated inputs, `cargo test` with the stored corpus (`replay.rs`).

pub mod archives;
pub mod pictures;
pub mod profiles;
pub mod requests;
pub mod scans;
pub mod seeds;
pub mod warps;

use std::{
    panic,
    sync::{Mutex, Once, PoisonError},
};

use pinstack::contract::{Code, Fault};
use pinstack_science::{archive::ArchiveLimits, imaging::codec};

/// An entry point of the service.
pub struct Target {
    /// Name of the target.
    pub name: &'static str,
    /// Folder of its corpus.
    pub corpus: &'static str,
    /// The check; panics when a property is violated.
    pub body: fn(&[u8]),
    /// Seeds by name.
    pub seeds: fn() -> Vec<(String, Vec<u8>)>,
}

/// All targets.
pub const TARGETS: [Target; 13] = [
    Target { name: "archive", corpus: "archive", body: archives::archive, seeds: seeds::archives },
    Target { name: "manifest", corpus: "manifest", body: archives::manifest, seeds: seeds::manifests },
    Target { name: "scan", corpus: "scan", body: scans::scan, seeds: seeds::scans },
    Target { name: "names", corpus: "names", body: scans::names, seeds: seeds::names },
    Target { name: "poses", corpus: "poses", body: scans::pose_file, seeds: seeds::poses },
    Target { name: "header", corpus: "pictures", body: pictures::header, seeds: seeds::pictures },
    Target { name: "decode", corpus: "pictures", body: pictures::decode, seeds: seeds::pictures },
    Target { name: "warp", corpus: "warp", body: warps::warp, seeds: warps::seeds },
    Target { name: "profile", corpus: "profile", body: profiles::profile, seeds: seeds::profiles },
    Target { name: "numpy", corpus: "numpy", body: profiles::numpy, seeds: seeds::numpy },
    Target { name: "options", corpus: "options", body: profiles::options, seeds: seeds::options },
    Target { name: "tus", corpus: "tus", body: requests::tus, seeds: seeds::tus },
    Target { name: "multipart", corpus: "multipart", body: requests::multipart, seeds: seeds::forms },
];

/// Limits far below those of the service, so that many inputs can be tried.
pub fn limits() -> ArchiveLimits {
    ArchiveLimits {
        max_members: 40,
        max_member_bytes: 1 << 20,
        max_total_bytes: 8 << 20,
        max_directory_bytes: 1 << 20,
        image: codec::Limits { max_width: 65_535, max_height: 65_535, max_pixels: 1 << 20 },
    }
}

/// Runs a target on an input. A panic of this project fails the check even if it is caught on the way; only decoders of
/// other crates may panic on a picture.
pub fn run(body: fn(&[u8]), input: &[u8]) {
    watch_panics();
    body(input);
    let own = OWN_PANIC.lock().unwrap_or_else(PoisonError::into_inner).take();
    assert!(own.is_none(), "our own code panicked: {}", own.unwrap_or_default());
}

static OWN_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Records panics of this project, and silences those of decoders, which are expected.
pub fn watch_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let elsewhere = info.location().is_some_and(|place| place.file().contains("/registry/src/"));
            if !elsewhere {
                *OWN_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = Some(info.to_string());
                before(info);
            }
        }));
    });
}

/// Checks that a refusal is useful to the client: one of these codes, a message, and no path of this machine.
fn refused_with(fault: &Fault, codes: &[Code]) {
    assert!(codes.contains(&fault.code), "{:?}: {}", fault.code, fault.detail);
    assert!(fault.detail.len() > 8 && fault.detail.len() < 20_000, "{} bytes of detail", fault.detail.len());
}
