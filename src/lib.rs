//! pinstack: calibrated focus stacking for photogrammetry, as an HTTP service.
//!
//! The service stores calibration profiles, takes zipped focus stacks, and runs jobs that fuse them. The work on pixels
//! and numbers is in the crate [`pinstack_science`], which knows no runtime, database, web framework or clock.
//!
//! Each module imports only from the modules above it in this list (`tests/project/architecture.rs` checks that,
//! `docs/ARCHITECTURE.md` gives the reasons).

#![forbid(unsafe_code)]
// what cannot be written must not panic: `cli::output`, and the log
#![warn(unreachable_pub, clippy::print_stdout, clippy::print_stderr)]

pub mod contract;
pub mod https;

pub mod telemetry;

pub mod supervision;

pub mod store;

pub mod disk_budget;

pub mod jobs;
pub mod worker;

pub mod settings;

pub mod http;

pub mod cli;
