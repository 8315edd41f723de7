//! The metadata of a picture file: ICC profile and EXIF.

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
    /// The metadata of an output of `width` x `height` px made from this file. There is an EXIF block even if the file
    /// has none.
    ///
    /// | field | in the output |
    /// |---|---|
    /// | size | `width` x `height` |
    /// | orientation | upright, because it was applied |
    /// | thumbnail, maker note | dropped: the first shows another picture, the second holds invalid offsets |
    /// | camera, lens, exposure, dates | kept |
    /// | focal length, focal plane resolution, software | from `camera` |
    #[must_use]
    pub fn for_output(&self, width: u32, height: u32, camera: &OutputCamera<'_>) -> Self {
        let exif = exif_output::for_output(self.exif.as_deref(), width, height, camera);
        Self { icc: self.icc.clone(), exif }
    }

    /// True when the file has a focal length.
    pub fn has_focal_length(&self) -> bool {
        self.exif.as_deref().and_then(exif_block::kept).is_some_and(|(fields, _)| {
            fields.iter().any(|field| [Tag::FocalLength, Tag::FocalLengthIn35mmFilm].contains(&field.tag))
        })
    }

    /// The EXIF tag `Software`.
    pub(super) fn software(&self) -> Option<String> {
        exif_block::text(self.exif.as_deref()?, Tag::Software)
    }

    /// The ICC profile, if it is for a picture of `channels` channels. A CMYK profile in an RGB file would silently
    /// give wrong colours.
    pub(super) fn icc_for(&self, channels: usize) -> Option<&[u8]> {
        let icc = self.icc.as_deref()?;
        let expected: &[u8] = if channels == 1 { b"GRAY" } else { b"RGB " };
        (icc.get(16..20) == Some(expected)).then_some(icc)
    }
}
