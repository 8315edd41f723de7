//! What responses show: rows without what is internal to the service (blob keys, leases).

pub mod advice;
pub mod calibration;
pub mod job;
pub mod list;
pub mod reconstruction;
pub mod scan;
pub mod scan_archive;
pub mod stack;

use serde::Serialize;

pub use calibration::Calibration;
pub use list::{CalibrationList, ProfileList, ReconstructionList, ScanList, StackList};
pub use reconstruction::Reconstruction;
pub use scan::ScanWithViews;
pub use stack::Stack;

use crate::{contract::request::JobRequest, store::Job};

/// A job as its URL shows it.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum JobDocument {
    /// A stack.
    Stack(Box<Stack>),
    /// A calibration.
    Calibration(Box<Calibration>),
    /// A reconstruction.
    Reconstruction(Box<Reconstruction>),
}

impl JobDocument {
    /// The view of a row.
    pub fn of(job: &Job) -> Self {
        match &job.request {
            JobRequest::Stack(request) => Self::Stack(Box::new(Stack::of(job, request))),
            JobRequest::Calibration(request) => Self::Calibration(Box::new(Calibration::of(job, request))),
            JobRequest::Reconstruction(request) => Self::Reconstruction(Box::new(Reconstruction::of(job, request))),
        }
    }
}
