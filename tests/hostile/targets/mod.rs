//! What is done with hostile bytes: one body per way into the service, with what must hold whatever the bytes are.
//!
//! The fuzzer (`fuzz/`) calls these bodies with what it makes up, `cargo test` with what is kept (`replay.rs`): both
//! judge alike, and on the same code.

pub mod archives;
pub mod pictures;
pub mod profiles;
pub mod requests;
pub mod seeds;
pub mod warps;

use std::{
    panic,
    sync::{Mutex, Once, PoisonError},
};

use pinstack::contract::{Code, Fault};
use pinstack_science::{archive::ArchiveLimits, imaging::codec};

/// A way into the service.
pub struct Target {
    /// Name of the target.
    pub name: &'static str,
    /// Folder of its corpus.
    pub corpus: &'static str,
    /// What is done with the bytes; panics when something does not hold.
    pub body: fn(&[u8]),
    /// Inputs to begin with, by name.
    pub seeds: fn() -> Vec<(String, Vec<u8>)>,
}

/// Every way in.
pub const TARGETS: [Target; 10] = [
    Target { name: "archive", corpus: "archive", body: archives::archive, seeds: seeds::archives },
    Target { name: "manifest", corpus: "manifest", body: archives::manifest, seeds: seeds::manifests },
    Target { name: "header", corpus: "pictures", body: pictures::header, seeds: seeds::pictures },
    Target { name: "decode", corpus: "pictures", body: pictures::decode, seeds: seeds::pictures },
    Target { name: "warp", corpus: "warp", body: warps::warp, seeds: warps::seeds },
    Target { name: "profile", corpus: "profile", body: profiles::profile, seeds: seeds::profiles },
    Target { name: "numpy", corpus: "numpy", body: profiles::numpy, seeds: seeds::numpy },
    Target { name: "options", corpus: "options", body: profiles::options, seeds: seeds::options },
    Target { name: "tus", corpus: "tus", body: requests::tus, seeds: seeds::tus },
    Target { name: "multipart", corpus: "multipart", body: requests::multipart, seeds: seeds::forms },
];

/// What the inputs may cost here: far less than the service allows, so that many can be tried.
pub fn limits() -> ArchiveLimits {
    ArchiveLimits {
        max_members: 40,
        max_member_bytes: 1 << 20,
        max_total_bytes: 8 << 20,
        max_directory_bytes: 1 << 20,
        image: codec::Limits { max_width: 65_535, max_height: 65_535, max_pixels: 1 << 20 },
    }
}

/// Runs a body on an input. A panic of our own code counts also where it is caught on the way: only decoders of other
/// crates are allowed to give up on a picture like that.
pub fn run(body: fn(&[u8]), input: &[u8]) {
    watch_panics();
    body(input);
    let own = OWN_PANIC.lock().unwrap_or_else(PoisonError::into_inner).take();
    assert!(own.is_none(), "our own code panicked: {}", own.unwrap_or_default());
}

static OWN_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Makes note of panics that come from this project and keeps silent about those of decoders, which are expected.
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

/// A refusal must be the client's to understand: one of these codes, a sentence, and no name of our machine.
fn refused_with(fault: &Fault, codes: &[Code]) {
    assert!(codes.contains(&fault.code), "{:?}: {}", fault.code, fault.detail);
    assert!(fault.detail.len() > 8 && fault.detail.len() < 20_000, "{} bytes of detail", fault.detail.len());
}
