//! The errors of this crate: a kind for programs, a message for people, locations, and the cause.

use std::{error::Error as StdError, sync::Arc};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::WarningCode;

/// The category of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// An argument or option is out of range, or two of them are contradictory.
    InvalidParameter,
    /// Not a zip, truncated, wrong CRC, or invalid member names.
    InvalidArchive,
    /// An encrypted member or an unsupported compression method.
    UnsupportedArchive,
    /// The archive has too many members, or its uncompressed size exceeds the limits.
    ArchiveTooLarge,
    /// A slice is not an image, is truncated, or declares implausible dimensions.
    InvalidImage,
    /// Slices differ in size, from one another or from the profile.
    SizeMismatch,
    /// The number of slices differs from that of the profile, or between front and back light.
    SliceCountMismatch,
    /// A homography is singular, mirrored or not finite, another value of the profile is impossible, or a file of
    /// matrices is malformed.
    InvalidProfile,
    /// A file of camera poses cannot be read, or has no poses.
    InvalidPoses,
    /// Too few dots, no grid, or a mirrored grid; in stacks of objects, too little detail that slices share.
    TargetNotFound,
    /// The disk that is written to is full, or a limit of its use is exceeded.
    DiskFull,
    /// Another resource is exhausted, possibly temporarily: threads, file handles, disk I/O.
    ResourcesExhausted,
    /// A file could not be read or written for another reason.
    Io,
    /// A defect of this crate.
    Internal,
}

/// The location of an error: a field, a file or a slice.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ErrorLocation {
    /// What is wrong at this location.
    pub detail: String,
    /// JSON pointer into the request body, or name of a parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointer: Option<String>,
    /// Name of the file inside the archive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// 0-based index of the slice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slice: Option<u32>,
}

/// An error of this crate.
///
/// `detail` is for the person who sent the data: one or two sentences about what is wrong, where, and what to do.
/// `kind` and `locations` carry the same information for programs. `source` is the error of the underlying library, if
/// any.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{detail}")]
pub struct Error {
    /// The category.
    pub kind: ErrorKind,
    /// What is wrong, where, and what to do.
    pub detail: String,
    /// The locations, if known.
    pub locations: Vec<ErrorLocation>,
    /// The error that caused this one.
    pub source: Option<Arc<dyn StdError + Send + Sync>>,
}

impl PartialEq for Error {
    /// Compares kind, detail and locations. The source is ignored.
    fn eq(&self, other: &Self) -> bool {
        (self.kind, &self.detail, &self.locations) == (other.kind, &other.detail, &other.locations)
    }
}

impl Eq for Error {}

impl Error {
    /// An error without locations and without a source.
    pub fn new(kind: ErrorKind, detail: impl Into<String>) -> Self {
        Self { kind, detail: detail.into(), locations: Vec::new(), source: None }
    }

    /// Adds a location.
    #[must_use]
    pub fn at(mut self, location: ErrorLocation) -> Self {
        self.locations.push(location);
        self
    }

    /// An error of several locations, with the sentence of the first and the number of the others. `None` without
    /// locations.
    pub fn of_locations(kind: ErrorKind, locations: Vec<ErrorLocation>) -> Option<Self> {
        let more = match locations.len() {
            0 | 1 => String::new(),
            n => format!(" ({} more in errors)", n - 1),
        };
        let detail = format!("{}{more}", locations.first()?.detail);
        Some(Self { kind, detail, locations, source: None })
    }

    /// Adds the file (and the 0-based slice) that the error concerns.
    #[must_use]
    pub fn in_file(self, file: impl Into<String>, slice: Option<u32>) -> Self {
        let detail = self.detail.clone();
        self.at(ErrorLocation { detail, file: Some(file.into()), slice, ..ErrorLocation::default() })
    }

    /// Adds the field or parameter (and the 0-based slice) that the error concerns.
    #[must_use]
    pub fn in_field(self, pointer: impl Into<String>, slice: Option<u32>) -> Self {
        let detail = self.detail.clone();
        self.at(ErrorLocation { detail, pointer: Some(pointer.into()), file: None, slice })
    }

    /// Adds the error that caused this one.
    #[must_use]
    pub fn caused_by(mut self, source: impl StdError + Send + Sync + 'static) -> Self {
        self.source = Some(Arc::new(source));
        self
    }
}

/// An observation for the user that did not stop the work.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// Stable machine-readable code, `snake_case`.
    #[schema(value_type = String)]
    pub code: WarningCode,
    /// One sentence.
    pub detail: String,
}

impl Warning {
    /// A warning with a code and one sentence.
    pub fn new(code: WarningCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }
}
