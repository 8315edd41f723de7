//! Focus stacks: one endpoint per file.

pub mod artifacts;
pub mod cancel;
pub mod create;
pub mod delete;
pub mod events;
pub mod get;
pub mod list;
pub mod metrics;
pub mod rerun;
pub mod upload;
