//! Links release builds for Linux with compressed debug sections.
//!
//! Line tables make backtraces name files and lines, but uncompressed they are three quarters of the binary. The standard
//! library reads compressed ones.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|found| found == value);
    if is("PROFILE", "release") && is("CARGO_CFG_TARGET_OS", "linux") {
        println!("cargo::rustc-link-arg-bins=-Wl,--compress-debug-sections=zlib");
    }
}
