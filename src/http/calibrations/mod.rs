//! Calibrations: one endpoint per file.

pub mod cancel;
pub mod create;
pub mod delete;
pub mod events;
pub mod get;
pub mod list;
pub mod overlay;
pub mod report;
