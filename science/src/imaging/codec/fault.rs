//! Why a file cannot be used as a picture.

use std::io;

use super::{Format, Limits};
use crate::types::{Error, ErrorKind};

/// Why a file cannot be used as a picture: a clause that follows the name of the file (`img_1.jpg: ...`).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageFault {
    /// Nothing in it.
    #[error("the file is empty (0 bytes): a copy or a tethered capture was interrupted; copy it again from the camera")]
    Empty,
    /// Camera raw.
    #[error("camera raw files ({0}) are not read; convert all slices alike to 16-bit TIFF or to JPEG")]
    Raw(&'static str),
    /// A picture of a kind that is not read.
    #[error("{0} pictures are not read; save the slices as JPEG, PNG or TIFF")]
    OtherFormat(&'static str),
    /// No picture at all.
    #[error("this is not a JPEG, PNG or TIFF picture")]
    Unknown,
    /// Width or height of zero.
    #[error("it declares {width} x {height} px, so it has no pixels")]
    NoPixels {
        /// Columns as declared.
        width: u32,
        /// Rows as declared.
        height: u32,
    },
    /// Over the limits.
    #[error(
        "it declares {width} x {height} px; at most {} x {} px and {} megapixels are read",
        limits.max_width, limits.max_height, limits.max_pixels / 1_000_000
    )]
    TooLarge {
        /// Columns as declared.
        width: u32,
        /// Rows as declared.
        height: u32,
        /// What is allowed.
        limits: Limits,
    },
    /// The file ends before the picture does.
    #[error("the {0} ends before the picture does (torn file); copy it again from the camera")]
    Torn(Format),
    /// The file breaks its own format.
    #[error("the {format} is damaged ({why}); copy it again from the camera")]
    Damaged {
        /// Kind of file.
        format: Format,
        /// What the decoder said.
        why: String,
    },
    /// A sound file that says its colours in a way that is not read.
    #[error("{what}; {advice}")]
    Unsupported {
        /// What it is.
        what: String,
        /// What to do.
        advice: &'static str,
    },
    /// The bytes could not be had at all: not the picture's fault.
    #[error("it could not be read ({0})")]
    Unreadable(String),
}

/// What to do with pictures in colours that are not read.
pub(super) const SAVE_PLAIN: &str = "save all slices as 8 or 16-bit grey or RGB (JPEG, PNG or TIFF)";

/// Longest clause of a decoder, in characters.
const MAX_CLAUSE: usize = 160;

/// The beginning of what a decoder says: some copy whole lists out of the file into their sentences.
fn shortened(clause: &str) -> String {
    match clause.char_indices().nth(MAX_CLAUSE) {
        Some((end, _)) => format!("{}...", &clause[..end]),
        None => clause.to_owned(),
    }
}

impl ImageFault {
    /// The fault of the file `name` (slice `slice`, 0-based).
    pub fn in_file(&self, name: &str, slice: Option<u32>) -> Error {
        let code = match self {
            Self::Unreadable(_) => ErrorKind::InvalidArchive,
            _ => ErrorKind::InvalidImage,
        };
        Error::new(code, format!("{name}: {self}")).in_file(name, slice)
    }

    /// A picture in colours that are not read.
    pub(super) fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported { what: shortened(&what.into()), advice: SAVE_PLAIN }
    }

    /// A file that breaks its own format.
    pub(super) fn damaged(format: Format, why: impl ToString) -> Self {
        Self::Damaged { format, why: shortened(&why.to_string()) }
    }

    /// What a failed read means: an early end is a torn file, anything else is not the picture's fault.
    pub(super) fn from_io(format: Format, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::Torn(format),
            _ => Self::Unreadable(error.to_string()),
        }
    }
}
