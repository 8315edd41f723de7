//! What the header of a picture says, and how large a picture may be.

use super::colour_space::ColourSpace;

/// Supported file formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// JPEG (baseline and progressive, Huffman coded, 8 bits).
    Jpeg,
    /// PNG.
    Png,
    /// TIFF and BigTIFF.
    Tiff,
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Jpeg => "JPEG",
            Self::Png => "PNG",
            Self::Tiff => "TIFF",
        })
    }
}

/// The header of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Columns, after the orientation is applied.
    pub width: u32,
    /// Rows, after the orientation is applied.
    pub height: u32,
    /// Channels that [`decode`](super::decode) returns: 1 grey or 3 RGB (alpha is dropped, palettes are expanded).
    pub channels: u8,
    /// 8 or 16.
    pub bit_depth: u8,
    /// File format.
    pub format: Format,
    /// EXIF orientation as stored, 1 to 8; 1 without a tag.
    pub orientation: u8,
    /// Colour space.
    pub colour: ColourSpace,
    /// When the picture was taken, by its EXIF data; of a TIFF without EXIF data, by its tag `DateTime`. `None`
    /// without.
    pub taken: Option<CaptureTime>,
}

/// A point in time by the clock of a camera, s. It grows with time, and is comparable with others of the same camera;
/// months count as 31 days.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct CaptureTime(pub u64);

/// Maximum size of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of columns.
    pub max_width: u32,
    /// Maximum number of rows.
    pub max_height: u32,
    /// Maximum number of pixels.
    pub max_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_width: 65_535, max_height: 65_535, max_pixels: 400_000_000 }
    }
}

impl Limits {
    /// Maximum allocation of a decoder for its result, bytes: four 16-bit channels.
    pub(super) fn max_bytes(&self) -> usize {
        usize::try_from(self.max_pixels.saturating_mul(8)).unwrap_or(usize::MAX)
    }
}
