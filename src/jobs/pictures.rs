//! The image files of a stack.
//!
//! In: the fused front light, the silhouette, the options and the profile. Out: all files but the fused back light, and
//! the description of the image. The image takes longest, so it is encoded in parallel with the others.

use std::sync::{Mutex, PoisonError};

use super::{
    SOFTWARE,
    artifact_writer::{ArtifactWriter, Encoding, WrittenArtifact},
};
use crate::contract::{
    JobError,
    artifact::StackArtifact,
    options::{BitDepth, ImageFormat, StackOptions, UnderAlpha},
    outcome::ImageInfo,
};
use pinstack_science::{
    fusion::Fused,
    imaging::{
        Depth, Plane, Raster, Rect,
        codec::{Metadata, OutputCamera},
        compositing, padding, thumbnail,
    },
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
    /// The part of the canvas that is written.
    pub rect: Rect,
    /// The options of the request.
    pub options: &'a StackOptions,
    /// The camera.
    pub profile: &'a ProfileInput,
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
        let (rect, options, front) = (self.rect, self.options, self.front);
        let (steps, done) = (StackArtifact::ALL.into_iter().filter(|of| self.has(*of)).count(), Mutex::new(0));
        let step = |picture: WrittenArtifact| {
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            control.progress("writing", *done, steps);
            picture
        };
        control.progress("writing", 0, steps);

        let info = self.info();
        let metadata = source.for_output(info.width, info.height, &self.camera());
        let keep_hidden_colour = options.under_alpha.is_fused_colour();
        let mut image = compositing::rgba(&front.image, &self.alpha(), rect, self.depth(), keep_hidden_colour);
        if options.under_alpha == UnderAlpha::Pad {
            padding::pad(&mut image);
        }
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
        let main = || writer.picture(StackArtifact::Image.name(), Encoding::of(options), &image, &metadata).map(step);
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
        let rect = self.rect;
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
        let depth = self.depth();
        let crop_offset_px = [number(self.rect.x), number(self.rect.y)];
        ImageInfo {
            width: number(self.rect.width),
            height: number(self.rect.height),
            bit_depth: if depth.bytes() == 2 { 16 } else { 8 },
            crop_offset_px,
            intrinsics: Intrinsics::of(self.profile, crop_offset_px),
        }
    }

    /// The bit depth of the image: as requested, or that of the slices. A JPEG has 8 bits.
    fn depth(&self) -> Depth {
        match self.options.bit_depth {
            BitDepth::Auto if self.options.format == ImageFormat::Jpeg => Depth::Eight,
            BitDepth::Auto => self.front.image.depth(),
            BitDepth::Eight => Depth::Eight,
            BitDepth::Sixteen => Depth::Sixteen,
        }
    }

    /// All slices are mapped to the reference slice, so the image has its pixels and its principal distance.
    fn camera(&self) -> OutputCamera<'static> {
        OutputCamera {
            principal_distance_mm: self.profile.principal_distance_mm,
            pixel_pitch_mm: self.profile.pixel_pitch_mm,
            software: SOFTWARE,
        }
    }

    /// Opaque where a slice covers the canvas and, with a back light, where the object is. Its edge is as soft as
    /// requested.
    fn alpha(&self) -> Plane<u8> {
        let valid = &self.front.valid;
        self.silhouette.map_or_else(|| valid.clone(), |silhouette| compositing::masked(silhouette.image_alpha(), valid))
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
