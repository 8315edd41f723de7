//! What went wrong, said for the person who reads it, with a code for the program that does.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::{Error, ErrorKind, error::ErrorLocation};

/// Stable machine-readable codes of everything that can be wrong. The HTTP status belongs to the HTTP
/// floor; the science knows only the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Code {
    /// A parameter, header or body that breaks a rule of the contract.
    InvalidRequest,
    /// No token, or one that is not known.
    Unauthorized,
    /// The token does not allow this.
    Forbidden,
    /// A page of another origin sent this from a browser, and the service asks for no token.
    CrossOriginRequest,
    /// `Host` names another server, and the service asks for no token.
    MisdirectedRequest,
    /// The token has too many requests in progress.
    TooManyRequests,
    /// No such URL, job, file or revision.
    NotFound,
    /// The URL exists, the method does not.
    MethodNotAllowed,
    /// No such method.
    MethodNotImplemented,
    /// No profile is stored under this rig and lens.
    ProfileNotFound,
    /// The job has not ended yet, so what was asked for does not exist yet.
    NotFinished,
    /// The job ended without this result (failed, cancelled, or made without a back light).
    NoResult,
    /// The zip was removed because its time was over; the results are there.
    UploadRemoved,
    /// The job is in a state in which this cannot be done.
    Conflict,
    /// `If-Match` named a revision that is not the current one.
    PreconditionFailed,
    /// The same `Idempotency-Key` came with another request.
    IdempotencyKeyReused,
    /// The body is of a kind that is not understood here.
    UnsupportedMediaType,
    /// `Accept` allows no kind that can be made.
    NotAcceptable,
    /// The `Range` lies behind the end of the file.
    RangeNotSatisfiable,
    /// The body is over the limit.
    UploadTooLarge,
    /// The body ended early or stopped coming.
    UploadIncomplete,
    /// The bytes of a request are not those of its `Upload-Checksum`.
    ChecksumMismatch,
    /// Another request holds the upload and does not let go.
    Locked,
    /// No room on the disk or in the quota.
    InsufficientStorage,
    /// Too many jobs wait already.
    QueueFull,
    /// Not a zip, torn, wrong CRC, or names that break the rules.
    InvalidArchive,
    /// Encrypted member or unknown compression.
    UnsupportedArchive,
    /// The archive would unpack past the limits or has too many members.
    ArchiveTooLarge,
    /// A slice that is no image, is torn, or declares absurd dimensions.
    InvalidImage,
    /// Slices of different size, or not of the profile's size.
    SizeMismatch,
    /// Not as many slices as the profile has, or front and back differ.
    SliceCountMismatch,
    /// Homographies that are singular, mirrored or not finite, or other numbers that cannot be.
    InvalidProfile,
    /// Too few dots, no grid, a mirrored grid.
    TargetNotFound,
    /// A mask was required and could not be made.
    MaskFailed,
    /// The job's worker died on it too often.
    WorkerLost,
    /// The server is going down or cannot work at the moment.
    Unavailable,
    /// Our own fault; the log has the details under the request id.
    Internal,
}

impl Code {
    /// True for errors of the machine that the service runs on (its disk, its database, its limits). The content of an
    /// upload is not their cause, and they may not come again: a job that meets one is tried again.
    pub fn is_of_the_machine(self) -> bool {
        matches!(self, Self::InsufficientStorage | Self::Unavailable)
    }

    /// True when the same upload would be refused in the same way however often it is completed: its content, its names
    /// or its options are wrong. False for what may pass: a full disk or queue, an error of the machine, bytes that did
    /// not arrive, a lock, a missing right.
    pub fn is_permanent(self) -> bool {
        match self {
            Self::InvalidRequest
            | Self::NotFound
            | Self::MethodNotAllowed
            | Self::ProfileNotFound
            | Self::NoResult
            | Self::UploadRemoved
            | Self::IdempotencyKeyReused
            | Self::UnsupportedMediaType
            | Self::NotAcceptable
            | Self::RangeNotSatisfiable
            | Self::UploadTooLarge
            | Self::InvalidArchive
            | Self::UnsupportedArchive
            | Self::ArchiveTooLarge
            | Self::InvalidImage
            | Self::SizeMismatch
            | Self::SliceCountMismatch
            | Self::InvalidProfile
            | Self::TargetNotFound
            | Self::MaskFailed => true,
            Self::Unauthorized
            | Self::Forbidden
            | Self::CrossOriginRequest
            | Self::MisdirectedRequest
            | Self::TooManyRequests
            | Self::MethodNotImplemented
            | Self::NotFinished
            | Self::Conflict
            | Self::PreconditionFailed
            | Self::UploadIncomplete
            | Self::ChecksumMismatch
            | Self::Locked
            | Self::InsufficientStorage
            | Self::QueueFull
            | Self::WorkerLost
            | Self::Unavailable
            | Self::Internal => false,
        }
    }

    /// As the contract spells it.
    pub fn name(self) -> String {
        match serde_json::to_value(self) {
            Ok(serde_json::Value::String(name)) => name,
            _ => "internal".to_owned(),
        }
    }
}

/// A fault that a person can act on: code, one clear sentence, and the places.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct Fault {
    /// Stable code.
    pub code: Code,
    /// What was wrong, where, and what to do: one or two sentences for a technician.
    pub detail: String,
    /// The locations, when there is more to say than the sentence does.
    pub locations: Vec<ErrorLocation>,
}

impl Fault {
    /// A fault with a code and a sentence.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), locations: Vec::new() }
    }

    /// Adds one place.
    #[must_use]
    pub fn at(mut self, place: ErrorLocation) -> Self {
        self.locations.push(place);
        self
    }

    /// Adds the file (and slice) that the fault concerns.
    #[must_use]
    pub fn in_file(self, file: impl Into<String>, slice: Option<u32>) -> Self {
        let detail = self.detail.clone();
        self.at(ErrorLocation { detail, file: Some(file.into()), slice, ..ErrorLocation::default() })
    }
}

/// An error as every answer and every failed job shows it (RFC 9457, `application/problem+json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// URI reference of the kind of problem: `/problems/{code}`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Short, the same for every problem of this code.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// What was wrong, where, and what to do.
    pub detail: String,
    /// The request or job that this happened to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// Stable machine-readable code.
    pub code: Code,
    /// The locations, where it helps.
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
