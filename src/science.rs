//! The science of pinstack: everything below the line in `docs/ARCHITECTURE.md`, as a crate of its own.
//!
//! Pure functions on pictures and numbers: no async runtime, no database, no clock. Cargo holds the line, because this
//! crate does not depend on any of them; and it lets the tests run optimised pictures under a service that compiles fast.
//! The crate `pinstack` shows these modules under its own name.

#![deny(unsafe_op_in_unsafe_fn)]
#![warn(missing_docs)]

// the ground floor: plain types, then pictures
pub mod imaging;
pub mod model;

// science
pub mod calibration;
pub mod fusion;
pub mod quality;
pub mod synth;

// from a hostile zip to ordered slices
pub mod archive;
