//! The science of pinstack: everything below the line in `docs/ARCHITECTURE.md`, as a crate of its own.
//!
//! Pure functions on pictures and numbers: no async runtime, no database, no clock. Cargo holds the line, because this
//! crate does not depend on any of them; and it lets the tests run optimised pictures under a service that compiles fast.
//! The crate `pinstack` shows these modules under its own name.

#![warn(missing_docs)]

pub mod archive;
pub mod calibration;
pub mod fusion;
pub mod imaging;
pub mod model;
pub mod quality;
pub mod synth;
