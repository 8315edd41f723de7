//! The image files of a stack.
//!
//! In: the fused front light, the silhouette, the options and the profile. Out: all files but the fused back light, and
//! the description of the image. The image takes longest, so it is encoded in parallel with the others.

use std::sync::{Mutex, PoisonError};

use super::{
    artifact_writer::{ArtifactWriter, Encoding, WrittenArtifact},
    output_form::OutputForm,
};
use crate::contract::{JobError, artifact::StackArtifact, outcome::ImageInfo};
use pinstack_science::{
    fusion::Fused,
    imaging::{Raster, codec::Metadata, compositing, thumbnail},
    segmentation::Silhouette,
    types::{Control, Warning, WarningCode, intrinsics::Intrinsics, profile::ProfileInput},
};

/// JPEG quality of the preview: artefacts are hardly visible at 1:1.
const PREVIEW_QUALITY: u8 = 82;

/// Longest side of the preview, px.
const PREVIEW_MAX_SIDE: usize = 800;

/// What the files are made from.
pub(super) struct Pictures<'a> {
    /// The fused front light.
    pub front: &'a Fused,
    /// The object mask, when there is a back light.
    pub silhouette: Option<&'a Silhouette>,
    /// How the image is written.
    pub form: &'a OutputForm<'a>,
}

impl Pictures<'_> {
    /// Writes the files. `source` is the metadata of the reference slice.
    ///
    /// # Errors
    /// [`JobError::Cancelled`], and a fault when a file cannot be written.
    pub(super) fn write(
        &self,
        writer: &ArtifactWriter<'_>,
        control: &dyn Control,
        source: &Metadata,
    ) -> Result<(ImageInfo, Vec<WrittenArtifact>), JobError> {
        let (steps, done) = (StackArtifact::ALL.into_iter().filter(|of| self.has(*of)).count(), Mutex::new(0));
        let step = |picture: WrittenArtifact| {
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            control.progress("writing", *done, steps);
            picture
        };
        control.progress("writing", 0, steps);

        let (form, info) = (self.form, self.info());
        let (image, metadata) = (form.picture(&self.front.image), form.metadata(source));
        let others = || -> Result<Vec<WrittenArtifact>, JobError> {
            // a web page needs the colour profile, and no EXIF
            let colours = Metadata { icc: metadata.icc.clone(), exif: None };
            let small = Encoding::Jpeg { quality: PREVIEW_QUALITY };
            let preview = thumbnail::flattened(&image, PREVIEW_MAX_SIDE);
            let mut written = vec![step(writer.picture(StackArtifact::Preview.name(), small, &preview, &colours)?)];
            for artifact in StackArtifact::ALL {
                if let Some(picture) = self.data(artifact) {
                    written.push(step(writer.png(artifact.name(), &picture, &Metadata::default())?));
                }
            }
            Ok(written)
        };
        let main = || writer.picture(StackArtifact::Image.name(), form.encoding(), &image, &metadata).map(step);
        let (main, others) = rayon::join(main, others);
        let mut written = vec![main?];
        written.append(&mut others?);
        Ok((info, written))
    }

    /// Whether a file is written here. `jobs/stack.rs` writes the fused back light, as soon as it is fused.
    fn has(&self, artifact: StackArtifact) -> bool {
        artifact != StackArtifact::Backlight
            && (!artifact.needs_back_light() || self.silhouette.is_some())
            && (!artifact.needs_height() || self.front.height_map.is_some())
    }

    /// The picture of a file of data, a PNG without metadata; `None` for pictures, and for what this stack does not
    /// have.
    fn data(&self, artifact: StackArtifact) -> Option<Raster> {
        let rect = self.form.rect;
        let (width, height) = (rect.width, rect.height);
        let heights = self.front.height_map.as_ref();
        match artifact {
            StackArtifact::Image | StackArtifact::Preview | StackArtifact::Backlight => None,
            // binary, for tools that accept no other masks
            StackArtifact::Mask => {
                let binary = compositing::masked(&self.silhouette?.mask, &self.front.valid);
                Some(Raster::eight(width, height, 1, binary.crop(rect).data))
            }
            StackArtifact::Depth => Some(Raster::sixteen(width, height, 1, self.front.index.crop(rect).data)),
            StackArtifact::Height => Some(heights?.picture(rect)),
            StackArtifact::HeightSigma => Some(heights?.sigma_picture(rect)),
        }
    }

    fn info(&self) -> ImageInfo {
        let number = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let OutputForm { rect, profile, .. } = *self.form;
        let depth = self.form.depth(&self.front.image);
        let crop_offset_px = [number(rect.x), number(rect.y)];
        ImageInfo {
            width: number(rect.width),
            height: number(rect.height),
            bit_depth: if depth.bytes() == 2 { 16 } else { 8 },
            crop_offset_px,
            intrinsics: Intrinsics::of(profile, crop_offset_px),
        }
    }
}

/// A warning when the slices carry a focal length and the image does not, because the profile has no principal
/// distance.
pub(super) fn dropped_focal_length(source: &Metadata, profile: &ProfileInput) -> Option<Warning> {
    let dropped = profile.principal_distance_mm.is_none() && source.has_focal_length();
    dropped.then(|| {
        Warning::new(
            WarningCode::FocalLengthDropped,
            "the slices carry the focal length of the lens, but the image does not: photogrammetry needs the principal \
             distance, which the profile lacks; the report of the calibration says what would make it known, or PUT the \
             profile with principal_distance_mm and pixel_pitch_mm",
        )
    })
}
