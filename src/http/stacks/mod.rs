//! Focus stacks: one endpoint per file, and those of the result files in one. The endpoints that calibrations have too
//! are in [`job_endpoints`](super::job_endpoints).

pub mod artifacts;
pub mod create;
pub mod lights;
pub mod metrics;
pub mod rerun;
pub mod totals;
pub mod upload;
