//! Calibrations: one endpoint per file. Those that stacks have too are in [`job_endpoints`](super::job_endpoints).

pub mod create;
pub mod overlay;
pub mod report;
pub mod stored;
