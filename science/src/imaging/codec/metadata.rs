//! What a picture file says besides its pixels.

use exif::Tag;

use super::{exif_block, exif_output, exif_output::OutputCamera};

/// ICC profile and EXIF of a picture file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Metadata {
    /// The ICC profile.
    pub icc: Option<Vec<u8>>,
    /// EXIF as a TIFF-structured block (`II*\0` or `MM\0*` first), without the `Exif\0\0` of JPEG.
    pub exif: Option<Vec<u8>>,
}

impl Metadata {
    /// The same for a picture of `width` x `height` px that was made from the file: size tags say so, the
    /// orientation is upright (it was applied), thumbnail and maker note are dropped (the one would show another
    /// picture, the other is full of offsets that no longer hold). Camera, lens, exposure and dates stay. Focal length,
    /// focal plane resolution and software are those of `camera`. There is a block even where the file has none.
    #[must_use]
    pub fn for_output(&self, width: u32, height: u32, camera: &OutputCamera<'_>) -> Self {
        let exif = exif_output::for_output(self.exif.as_deref(), width, height, camera);
        Self { icc: self.icc.clone(), exif }
    }

    /// Whether the file names a focal length.
    pub fn has_focal_length(&self) -> bool {
        self.exif.as_deref().and_then(exif_block::kept).is_some_and(|(fields, _)| {
            fields.iter().any(|field| [Tag::FocalLength, Tag::FocalLengthIn35mmFilm].contains(&field.tag))
        })
    }

    /// The program that made the file, as its EXIF names it.
    pub(super) fn software(&self) -> Option<String> {
        exif_block::text(self.exif.as_deref()?, Tag::Software)
    }

    /// The ICC profile, when it is meant for a picture of `channels` channels (a CMYK profile in an RGB file
    /// would give wrong colours in silence).
    pub(super) fn icc_for(&self, channels: usize) -> Option<&[u8]> {
        let icc = self.icc.as_deref()?;
        let expected: &[u8] = if channels == 1 { b"GRAY" } else { b"RGB " };
        (icc.get(16..20) == Some(expected)).then_some(icc)
    }
}
