//! pinstack: calibrated focus stacking for photogrammetry, as a library and a service.
//!
//! A *focus stack* is a set of slices of one view, taken with the sensor (or the lens) at a different
//! rail position each. A *calibration profile* holds one homography per slice that maps slice pixels to
//! reference-slice pixels. Fusing the warped slices gives one picture that is still a perspective image,
//! which is what structure from motion needs (Li & Nguyen, DICTA 2019).
//!
//! The modules form floors: each imports only from those below it (`docs/ARCHITECTURE.md`,
//! held by `tests/architecture.rs`). Everything up to [`archive`] is pure: no async runtime, no
//! database, no clock.

// unsafe code lies in the kernels of `pinstack-science` alone
#![forbid(unsafe_code)]
#![warn(missing_docs)]

// Everything below the line is the crate `pinstack-science`, so that Cargo holds the line; it is known under one name.
pub use pinstack_science::{archive, calibration, fusion, imaging, model, quality, synth};

pub mod telemetry;

pub mod store;

pub mod disk_budget;

pub mod jobs;
pub mod worker;

pub mod http;

pub mod cli;
