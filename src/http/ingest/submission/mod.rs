//! What a zip is submitted for: a stack to fuse, or a dot target or stacks to calibrate from.
//!
//! In: the fields of a request. Out: checked names and options with the profile they refer to, before any byte of the
//! zip is read; later the request of the job, checked against the contents of the zip.

pub mod calibration;
pub mod scan;
pub mod stack;

use pinstack_science::types::{Warning, stack_layout::StackLayout};
use serde_json::Value;

use self::{calibration::CalibrationSubmission, stack::StackSubmission};
use super::{fields::Fields, receivable::Receivable};
use crate::{
    contract::{
        Fault, JobKind, Name,
        request::{JobRequest, Upload},
    },
    http::{ApiError, ApiResult, App, auth::Caller},
};

/// A submission whose names, options and profile are valid.
pub enum Submission {
    /// A stack to fuse.
    Stack(Box<StackSubmission>),
    /// A dot target, or stacks, to calibrate from.
    Calibration(Box<CalibrationSubmission>),
}

impl Receivable for Submission {
    type Target = JobKind;

    /// # Errors
    /// `invalid_request` that names the field; of a stack `profile_not_found` and `scan_not_found`.
    async fn read(app: &App, caller: &Caller, kind: &JobKind, fields: &Fields) -> ApiResult<Self> {
        Ok(match kind {
            JobKind::Stack => Self::Stack(Box::new(StackSubmission::read(app, caller, fields).await?)),
            JobKind::Calibration => Self::Calibration(Box::new(CalibrationSubmission::read(app, fields).await?)),
            JobKind::Reconstruction => return Err(ApiError::internal("a reconstruction is not made from a zip")),
        })
    }

    /// What the job may write, as far as this is known before the upload arrives. 0 for a calibration: the number of
    /// slices is unknown, and little is written for each.
    fn disk_need(&self, _announced: u64) -> u64 {
        match self {
            Self::Stack(stack) => stack.disk_need(),
            Self::Calibration(_) => 0,
        }
    }

    fn max_bytes(app: &App) -> u64 {
        app.policy.max_upload_bytes
    }
}

impl Submission {
    /// The kind of job it becomes.
    pub fn kind(&self) -> JobKind {
        match self {
            Self::Stack(_) => JobKind::Stack,
            Self::Calibration(_) => JobKind::Calibration,
        }
    }

    /// Whether the zip may be that of a scan.
    pub fn may_be_scan(&self) -> bool {
        match self {
            Self::Stack(_) => false,
            Self::Calibration(calibration) => calibration.may_be_scan(),
        }
    }

    /// Rig and lens.
    pub fn profile_key(&self) -> (&Name, &Name) {
        match self {
            Self::Stack(stack) => stack.profile_key(),
            Self::Calibration(calibration) => calibration.profile_key(),
        }
    }

    /// What the client asked for. Part of the fingerprint that tells whether a repeated `Idempotency-Key` comes with
    /// the same request.
    pub fn fingerprint_input(&self) -> Value {
        match self {
            Self::Stack(stack) => stack.fingerprint_input(),
            Self::Calibration(calibration) => calibration.fingerprint_input(),
        }
    }

    /// Checks the contents of the zip and builds the request that the row of the job keeps.
    ///
    /// # Errors
    /// `size_mismatch`, `slice_count_mismatch` and others, with the number found and the number expected.
    pub fn to_request(&self, upload: Upload, layout: StackLayout) -> Result<(JobRequest, Vec<Warning>), Fault> {
        match self {
            Self::Stack(stack) => {
                let warnings = stack.unknown_orientation(&layout).into_iter().collect();
                Ok((JobRequest::Stack(stack.to_request(upload, layout)?), warnings))
            }
            Self::Calibration(calibration) => {
                let (request, warnings) = calibration.to_request(upload, layout)?;
                Ok((JobRequest::Calibration(request), warnings))
            }
        }
    }
}
