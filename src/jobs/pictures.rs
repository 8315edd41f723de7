//! The picture files of a stack.
//!
//! In: the fused front light, the silhouette, the options and the profile. Out: image, preview, mask and depth as files, and
//! what is known about the image. The image, which takes longest, is written beside the others.

use std::sync::{Mutex, PoisonError};

use super::{
    SOFTWARE,
    artifact_writer::{ArtifactWriter, Encoding, WrittenArtifact},
    compose,
    preview::preview,
};
use crate::contract::{JobError, options::StackOptions, outcome::ImageInfo};
use pinstack_science::{
    fusion::Fused,
    imaging::{
        Plane, Raster, Rect,
        codec::{Metadata, OutputCamera},
    },
    segmentation::Silhouette,
    types::{Control, Warning, intrinsics::Intrinsics, profile::ProfileInput},
};

/// Quality of a preview: its errors are hardly seen at 1:1.
const PREVIEW_QUALITY: u8 = 82;

/// What the pictures are made from.
pub(super) struct Pictures<'a> {
    /// The fused front light.
    pub front: &'a Fused,
    /// What is object, where there is a back light.
    pub silhouette: Option<&'a Silhouette>,
    /// The part of the canvas that comes out.
    pub rect: Rect,
    /// What was asked for.
    pub options: &'a StackOptions,
    /// The camera.
    pub profile: &'a ProfileInput,
}

impl Pictures<'_> {
    /// Writes the files. `source` is the metadata of the reference slice.
    ///
    /// # Errors
    /// [`JobError::Cancelled`]; a fault when a file cannot be written.
    pub(super) fn write(
        &self,
        writer: &ArtifactWriter<'_>,
        control: &dyn Control,
        source: &Metadata,
    ) -> Result<(ImageInfo, Vec<WrittenArtifact>), JobError> {
        let (rect, options, front) = (self.rect, self.options, self.front);
        let (steps, done) = (if self.silhouette.is_some() { 4 } else { 3 }, Mutex::new(0));
        let step = |picture: WrittenArtifact| {
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            control.progress("writing", *done, steps);
            picture
        };
        control.progress("writing", 0, steps);

        let info = self.info();
        let metadata = source.for_output(info.width, info.height, &self.camera());
        let depth = compose::depth(options.bit_depth, options.format, front.image.depth());
        let image = compose::rgba(&front.image, &self.alpha(), rect, depth, options.under_alpha);
        let others = || -> Result<Vec<WrittenArtifact>, JobError> {
            // a page needs the colours right and nothing else
            let colours = Metadata { icc: metadata.icc.clone(), exif: None };
            let small = Encoding::Jpeg { quality: PREVIEW_QUALITY };
            let mut written = vec![step(writer.picture("preview", small, &preview(&image), &colours)?)];
            if let Some(silhouette) = self.silhouette {
                // the mask is for tools that know two values alone
                let hard = within(&front.valid, &silhouette.alpha);
                let mask = Raster::eight(rect.width, rect.height, 1, compose::cropped_plane(&hard, rect));
                written.push(step(writer.png("mask", &mask, &Metadata::default())?));
            }
            let index = Raster::sixteen(rect.width, rect.height, 1, compose::cropped_plane(&front.index, rect));
            written.push(step(writer.png("depth", &index, &Metadata::default())?));
            Ok(written)
        };
        let main = || writer.picture("image", Encoding::of(options), &image, &metadata).map(step);
        let (main, others) = rayon::join(main, others);
        let mut written = vec![main?];
        written.append(&mut others?);
        Ok((info, written))
    }

    fn info(&self) -> ImageInfo {
        let number = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let depth = compose::depth(self.options.bit_depth, self.options.format, self.front.image.depth());
        let crop_offset_px = [number(self.rect.x), number(self.rect.y)];
        ImageInfo {
            width: number(self.rect.width),
            height: number(self.rect.height),
            bit_depth: if depth.bytes() == 2 { 16 } else { 8 },
            crop_offset_px,
            intrinsics: Intrinsics::of(self.profile, crop_offset_px),
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

    /// Opaque where a slice covers the canvas and, with a back light, the object is; at its edge as soft as asked.
    fn alpha(&self) -> Plane<u8> {
        let valid = &self.front.valid;
        self.silhouette.map_or_else(|| valid.clone(), |silhouette| within(valid, silhouette.of_picture()))
    }
}

/// `alpha` where `valid` is 255.
fn within(valid: &Plane<u8>, alpha: &Plane<u8>) -> Plane<u8> {
    let data = valid.data.iter().zip(&alpha.data).map(|(&v, &a)| v & a).collect();
    Plane { width: valid.width, height: valid.height, data }
}

/// The camera names a focal length that the image does not carry, because the profile does not know the principal distance.
pub(super) fn untold_focal_length(source: &Metadata, profile: &ProfileInput) -> Option<Warning> {
    let dropped = profile.principal_distance_mm.is_none() && source.has_focal_length();
    dropped.then(|| {
        Warning::new(
            "focal_length_dropped",
            "the slices name the focal length of the lens, and the image names none: photogrammetry needs the principal \
             distance f (1 + M), which the profile does not know; calibrate with focal_mm, target_pitch_mm and \
             pixel_pitch_mm, or PUT the profile with principal_distance_mm and pixel_pitch_mm",
        )
    })
}
