//! The HTTP floor: requests in, views out. [`router`] is the table of contents; one endpoint per file below;
//! [`problem`] is the only place where an error becomes a status.

pub mod artifacts;
pub mod auth;
pub mod background;
pub mod calibrations;
pub mod connections;
pub mod extract;
pub mod intake;
pub mod log;
pub mod middleware;
pub mod pages;
pub mod problem;
pub mod profiles;
pub mod recent;
pub mod router;
pub mod serve;
pub mod stacks;
pub mod state;
pub mod system;
pub mod uploads;
pub mod views;
pub mod waiting;
pub mod watch;

pub use serve::{serve, serve_over};
pub use state::{App, Policy};
