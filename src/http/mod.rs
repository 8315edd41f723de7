//! The HTTP layer: requests in, views out. [`router`] lists every URL. Each endpoint has a file of its own, except
//! those of [`job_endpoints`] and the files of a stack ([`stacks::artifacts`]), which macros make. [`problem`] is the
//! only place where an error becomes an answer. A problem code is one row in [`problem_types`].

#![warn(clippy::disallowed_methods)]

// first, because its macro is in scope from here on
#[macro_use]
pub mod links;

pub mod artifacts;
pub mod auth;
pub mod background;
pub mod calibrations;
pub mod connections;
pub mod extract;
pub mod ingest;
pub mod job_endpoints;
pub mod job_resource;
pub mod log;
pub mod middleware;
pub mod notes;
pub mod optics;
pub mod pages;
pub mod poses;
pub mod problem;
pub mod problem_types;
pub mod profiles;
pub mod reconstructions;
pub mod router;
pub mod scans;
pub mod serve;
pub mod session;
pub mod sse;
pub mod stacks;
pub mod state;
pub mod system;
pub mod targets;
pub mod uploads;
pub mod views;
pub mod wait_times;
pub mod waiting;

pub use crate::settings::Policy;
pub use problem::{ApiError, ApiResult};
pub use serve::{serve, serve_over};
pub use state::App;
