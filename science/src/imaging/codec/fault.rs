//! The reasons why a file cannot be used as a picture.

use std::io;

use super::header::{Format, Limits};
use crate::types::{Error, ErrorKind};

/// Why a file cannot be used as a picture. The message is a clause that follows the file name (`img_1.jpg: ...`).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageFault {
    /// The file has no bytes.
    #[error("the file is empty (0 bytes); a copy or a tethered capture was interrupted: copy it again from the camera")]
    Empty,
    /// A camera raw file.
    #[error(
        "camera raw files ({0}) are not supported; convert all slices, with the same settings, to 16-bit TIFF or JPEG \
         (pinstack convert of the Python package does that)"
    )]
    Raw(&'static str),
    /// A picture in a format that is not supported.
    #[error("{0} pictures are not supported; save the slices as JPEG, PNG or TIFF")]
    OtherFormat(&'static str),
    /// Not a picture.
    #[error("this is not a JPEG, PNG or TIFF picture; save the slices in one of these formats")]
    Unknown,
    /// The width or the height is zero.
    #[error("its header declares {width} x {height} px, which is no picture; save it again")]
    NoPixels {
        /// Columns as declared.
        width: u32,
        /// Rows as declared.
        height: u32,
    },
    /// The size exceeds the limits.
    #[error(
        "its header declares {width} x {height} px; at most {} x {} px and {} megapixels are allowed; reduce or crop \
         all slices alike",
        limits.max_width, limits.max_height, limits.max_pixels / 1_000_000
    )]
    TooLarge {
        /// Columns as declared.
        width: u32,
        /// Rows as declared.
        height: u32,
        /// The limits.
        limits: Limits,
    },
    /// The file is truncated.
    #[error("the {0} ends before the picture does (truncated file); copy it again from the camera")]
    Truncated(Format),
    /// The file violates its format.
    #[error("the {format} is damaged ({why}); copy it again from the camera")]
    Damaged {
        /// Kind of file.
        format: Format,
        /// What is wrong, in our words: those of a decoder are for its developers.
        why: &'static str,
    },
    /// The decoder failed by a panic: the file is damaged, or the decoder does not expect its layout.
    #[error(
        "the {0} cannot be decoded: it is damaged, or of an unusual kind; save it again as an ordinary TIFF, \
         PNG or JPEG"
    )]
    Undecodable(Format),
    /// A valid file with a feature that is not supported.
    #[error("{what}; {advice}")]
    Unsupported {
        /// The feature.
        what: String,
        /// What to do.
        advice: &'static str,
    },
    /// The bytes could not be read, so nothing is known about the picture.
    #[error("it could not be read ({0}); send the zip again")]
    Unreadable(String),
}

/// The advice for pictures in a colour format that is not supported.
pub(super) const SAVE_PLAIN: &str = "save all slices as 8 or 16-bit grey or RGB (JPEG, PNG or TIFF)";

impl ImageFault {
    /// The error for the file `name` (slice `slice`, 0-based), with this fault as its source.
    pub fn in_file(&self, name: &str, slice: Option<u32>) -> Error {
        let kind = match self {
            Self::Unreadable(_) => ErrorKind::InvalidArchive,
            _ => ErrorKind::InvalidImage,
        };
        Error::new(kind, format!("{name}: {self}")).in_file(name, slice).caused_by(self.clone())
    }

    /// A colour format or coding that is not supported.
    pub(super) fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported { what: what.into(), advice: SAVE_PLAIN }
    }

    /// A file that violates its format.
    pub(super) fn damaged(format: Format, why: &'static str) -> Self {
        Self::Damaged { format, why }
    }

    /// The fault for a failed read: an early end is a truncated file, any other error concerns the reader.
    pub(super) fn from_io(format: Format, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::Truncated(format),
            _ => Self::Unreadable(error.to_string()),
        }
    }
}

impl Limits {
    /// Refuses sizes that are zero or exceed a limit.
    pub(super) fn check(&self, width: u32, height: u32) -> Result<(), ImageFault> {
        if width == 0 || height == 0 {
            return Err(ImageFault::NoPixels { width, height });
        }
        let pixels = u64::from(width) * u64::from(height);
        if width > self.max_width || height > self.max_height || pixels > self.max_pixels {
            return Err(ImageFault::TooLarge { width, height, limits: *self });
        }
        Ok(())
    }
}

/// Runs a decoder of another crate on an untrusted file. A panic (assertions fail on unusual layouts) becomes a
/// refusal. The decoder is dropped afterwards, so a broken state cannot be observed.
pub(super) fn catch_panic<T>(format: Format, decode: impl FnOnce() -> Result<T, ImageFault>) -> Result<T, ImageFault> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode)).unwrap_or(Err(ImageFault::Undecodable(format)))
}
