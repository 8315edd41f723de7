//! The metadata of a picture file: ICC profile and EXIF.

use std::borrow::Cow;

use exif::Tag;

use super::{exif_block, exif_output, exif_output::OutputCamera, icc};

/// ICC profile and EXIF of a picture file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Metadata {
    /// The ICC profile: that of the file, or one for the colour space that the file declares in another way.
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

    /// The ICC profile for a picture of `channels` channels. The profile of grey slices is written anew for an output
    /// in colour. A profile of another kind of picture would give wrong colours and is omitted.
    pub(super) fn icc_for(&self, channels: usize) -> Option<Cow<'_, [u8]>> {
        let icc = self.icc.as_deref()?;
        match (icc.get(16..20)?, channels) {
            (b"GRAY", 1) => Some(icc.into()),
            (b"GRAY", _) => icc::rgb_of_grey(icc).map(Cow::Owned),
            (b"RGB ", 3 | 4) => Some(icc.into()),
            _ => None,
        }
    }
}
