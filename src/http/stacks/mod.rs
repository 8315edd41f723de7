//! Focus stacks: one endpoint per file. Those that calibrations have too are in [`job_endpoints`](super::job_endpoints).

pub mod artifacts;
pub mod create;
pub mod metrics;
pub mod rerun;
pub mod upload;
