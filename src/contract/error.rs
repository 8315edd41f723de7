//! Errors of the service: a code for programs and a sentence for people.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::{Error, ErrorKind, error::ErrorLocation};

/// Stable machine-readable error codes. `http::problem_types` has the status, title and description of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Code {
    /// A parameter, header or body breaks a rule of the contract.
    InvalidRequest,
    /// The token is missing or not valid.
    Unauthorized,
    /// The token does not allow this.
    Forbidden,
    /// A page of another origin sent this from a browser, and the service requires no token.
    CrossOriginRequest,
    /// `Host` names another server, and the service requires no token.
    MisdirectedRequest,
    /// The token has too many requests in progress.
    TooManyRequests,
    /// No such URL, job, file or revision.
    NotFound,
    /// The URL exists, the method does not.
    MethodNotAllowed,
    /// The method is not supported at all.
    MethodNotImplemented,
    /// No profile is stored under this rig and lens.
    ProfileNotFound,
    /// No scan is stored under this name.
    ScanNotFound,
    /// The stack is of another rig or lens than the scan, or the views of a scan do not fit together.
    ScanMismatch,
    /// The job has not ended, so the result does not exist yet.
    NotFinished,
    /// The job ended without this result (failed, cancelled, or made without a back light).
    NoResult,
    /// The zip has expired and was removed; the results remain.
    UploadRemoved,
    /// The state of the job does not allow this.
    Conflict,
    /// `If-Match` named a revision that is not the current one.
    PreconditionFailed,
    /// The same `Idempotency-Key` came with another request.
    IdempotencyKeyReused,
    /// The media type of the body is not supported.
    UnsupportedMediaType,
    /// `Accept` allows no available media type.
    NotAcceptable,
    /// The `Range` begins after the end of the file.
    RangeNotSatisfiable,
    /// The body is over the limit, or takes longer to store than one request may.
    UploadTooLarge,
    /// The body ended early, or no data arrived until the timeout.
    UploadIncomplete,
    /// The bytes of a request do not match its `Upload-Checksum`.
    ChecksumMismatch,
    /// The upload is locked by another request.
    Locked,
    /// Not enough space on the disk or in the quota.
    InsufficientStorage,
    /// Too many jobs are queued.
    QueueFull,
    /// Not a zip, truncated, wrong CRC, or names that break the rules.
    InvalidArchive,
    /// Encrypted member or unknown compression.
    UnsupportedArchive,
    /// The archive would unpack past the limits or has too many members.
    ArchiveTooLarge,
    /// A slice is not an image, is truncated, or declares absurd dimensions.
    InvalidImage,
    /// Slices of different size, or not of the profile's size.
    SizeMismatch,
    /// Not as many slices as the profile has, or front and back differ.
    SliceCountMismatch,
    /// Homographies that are singular, mirrored or not finite, or other impossible numbers.
    InvalidProfile,
    /// A file of camera poses that cannot be read, or has no poses.
    InvalidPoses,
    /// Too few dots, no grid, or a mirrored grid.
    TargetNotFound,
    /// A mask was required and could not be made.
    MaskFailed,
    /// COLMAP failed, or exceeded a limit of time, memory or disk.
    ReconstructionFailed,
    /// The worker died several times while it ran the job.
    WorkerLost,
    /// The server is shutting down or temporarily unable to work.
    Unavailable,
    /// An internal error; the log has the cause under the request id.
    Internal,
}

impl Code {
    /// True for errors of the machine (its disk, database or limits), which the content of an upload does not cause. A
    /// job that fails with one is retried.
    pub fn is_of_the_machine(self) -> bool {
        matches!(self, Self::InsufficientStorage | Self::Unavailable)
    }

    /// Name in JSON.
    pub fn name(self) -> String {
        match serde_json::to_value(self) {
            Ok(serde_json::Value::String(name)) => name,
            _ => "internal".to_owned(),
        }
    }
}

/// An error that a person can act on: code, sentence and locations.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct Fault {
    /// Stable code.
    pub code: Code,
    /// What is wrong, where, and what to do: one or two sentences for a technician.
    pub detail: String,
    /// Locations, when there is more than the sentence names.
    pub locations: Vec<ErrorLocation>,
}

impl Fault {
    /// A fault without locations.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), locations: Vec::new() }
    }

    /// Refuses a request that breaks rules, if there are any; the first is the detail.
    ///
    /// # Errors
    /// [`Code::InvalidRequest`] with the locations.
    pub fn refuse(locations: Vec<ErrorLocation>) -> Result<(), Self> {
        match locations.first() {
            None => Ok(()),
            Some(first) => Err(Self { code: Code::InvalidRequest, detail: first.detail.clone(), locations }),
        }
    }

    /// Adds a location.
    #[must_use]
    pub fn at(mut self, location: ErrorLocation) -> Self {
        self.locations.push(location);
        self
    }

    /// Adds the file, and the slice if known, as a location.
    #[must_use]
    pub fn in_file(self, file: impl Into<String>, slice: Option<u32>) -> Self {
        let detail = self.detail.clone();
        self.at(ErrorLocation { detail, file: Some(file.into()), slice, ..ErrorLocation::default() })
    }
}

/// An error as in error answers and failed jobs (RFC 9457, `application/problem+json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// URI reference of the problem type: `/problems/{code}`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Short summary, the same for every problem of this code.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// What is wrong, where, and what to do.
    pub detail: String,
    /// The request or job that this belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// Stable machine-readable code.
    pub code: Code,
    /// Locations, where they help.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<ErrorLocation>,
}

impl From<ErrorKind> for Code {
    fn from(kind: ErrorKind) -> Self {
        match kind {
            ErrorKind::InvalidParameter => Self::InvalidRequest,
            ErrorKind::InvalidArchive => Self::InvalidArchive,
            ErrorKind::UnsupportedArchive => Self::UnsupportedArchive,
            ErrorKind::ArchiveTooLarge => Self::ArchiveTooLarge,
            ErrorKind::InvalidImage => Self::InvalidImage,
            ErrorKind::SizeMismatch => Self::SizeMismatch,
            ErrorKind::SliceCountMismatch => Self::SliceCountMismatch,
            ErrorKind::InvalidProfile => Self::InvalidProfile,
            ErrorKind::InvalidPoses => Self::InvalidPoses,
            ErrorKind::TargetNotFound => Self::TargetNotFound,
            ErrorKind::DiskFull => Self::InsufficientStorage,
            ErrorKind::ResourcesExhausted => Self::Unavailable,
            ErrorKind::Io | ErrorKind::Internal => Self::Internal,
        }
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self { code: error.kind.into(), detail: error.detail, locations: error.locations }
    }
}
