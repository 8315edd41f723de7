//! What can go wrong in the science: a kind for the program, a sentence for the person, the places, and the cause.

use std::{error::Error as StdError, sync::Arc};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What kind of thing went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// An argument or an option is out of its range, or two of them contradict each other.
    InvalidParameter,
    /// Not a zip, torn, wrong CRC, or names that break the rules.
    InvalidArchive,
    /// An encrypted member or an unknown compression.
    UnsupportedArchive,
    /// The archive would unpack past the limits or has too many members.
    ArchiveTooLarge,
    /// A slice that is no image, is torn, or declares absurd dimensions.
    InvalidImage,
    /// Slices of different sizes, or not of the profile's size.
    SizeMismatch,
    /// Not as many slices as the profile has, or front and back light differ.
    SliceCountMismatch,
    /// Homographies that are singular, mirrored or not finite, or other numbers that no rig has.
    InvalidProfile,
    /// Too few dots, no grid, or a mirrored grid.
    TargetNotFound,
    /// The disk of the scratch file is full.
    DiskFull,
    /// The machine ran out of something else that may be free again later: threads, file handles.
    ResourcesExhausted,
    /// A file could not be read or written, for a reason that is neither of the two above.
    Io,
    /// A defect of this crate.
    Internal,
}

/// Where something is wrong: a field, a file or a slice.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ErrorLocation {
    /// What is wrong there.
    pub detail: String,
    /// JSON pointer into the request body, or the name of a parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pointer: Option<String>,
    /// Name of the file inside the archive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// 0-based index of the slice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slice: Option<u32>,
}

/// An error of the science.
///
/// `detail` is one or two sentences for the person who sent the data: what is wrong, where, and what to do. `kind` and
/// `locations` say the same to a program. `source` is the error of the library beneath, where there was one.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{detail}")]
pub struct Error {
    /// What kind of thing went wrong.
    pub kind: ErrorKind,
    /// What is wrong, where, and what to do.
    pub detail: String,
    /// The places, when there is more to say than the sentence does.
    pub locations: Vec<ErrorLocation>,
    /// The error that caused this one.
    pub source: Option<Arc<dyn StdError + Send + Sync>>,
}

impl PartialEq for Error {
    /// Equal when they say the same; the source is not looked at.
    fn eq(&self, other: &Self) -> bool {
        (self.kind, &self.detail, &self.locations) == (other.kind, &other.detail, &other.locations)
    }
}

impl Eq for Error {}

impl Error {
    /// An error with a kind and a sentence.
    pub fn new(kind: ErrorKind, detail: impl Into<String>) -> Self {
        Self { kind, detail: detail.into(), locations: Vec::new(), source: None }
    }

    /// Adds a location.
    #[must_use]
    pub fn at(mut self, location: ErrorLocation) -> Self {
        self.locations.push(location);
        self
    }

    /// Adds the file (and the 0-based slice) that the error concerns.
    #[must_use]
    pub fn in_file(self, file: impl Into<String>, slice: Option<u32>) -> Self {
        let detail = self.detail.clone();
        self.at(ErrorLocation { detail, file: Some(file.into()), slice, ..ErrorLocation::default() })
    }

    /// Adds the error that caused this one.
    #[must_use]
    pub fn caused_by(mut self, source: impl StdError + Send + Sync + 'static) -> Self {
        self.source = Some(Arc::new(source));
        self
    }
}

/// Something that did not stop the work but that the user should know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// Stable machine-readable code, `snake_case`.
    pub code: String,
    /// One sentence.
    pub detail: String,
}

impl Warning {
    /// A warning with a code and a sentence.
    pub fn new(code: &str, detail: impl Into<String>) -> Self {
        Self { code: code.to_owned(), detail: detail.into() }
    }
}
