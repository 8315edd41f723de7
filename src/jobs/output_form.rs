//! How the fused picture of a light is written: which part of it, how opaque, and in which format.

use super::{SOFTWARE, artifact_writer::Encoding};
use crate::contract::options::{BitDepth, ImageFormat, StackOptions, UnderAlpha};
use pinstack_science::{
    imaging::{
        Depth, Plane, Raster, Rect,
        codec::{Metadata, OutputCamera},
        compositing, padding,
    },
    segmentation::Silhouette,
    types::profile::ProfileInput,
};

/// The form that the pictures of all lights of a stack have in common.
pub(super) struct OutputForm<'a> {
    /// Opacity, of the size of the canvas.
    pub alpha: Plane<u8>,
    /// The part of the canvas that is written.
    pub rect: Rect,
    /// The options of the request.
    pub options: &'a StackOptions,
    /// The camera.
    pub profile: &'a ProfileInput,
}

impl<'a> OutputForm<'a> {
    /// The form for `rect` of a canvas that slices cover where `valid` is 255. Opaque is what they cover and, with a
    /// back light, the object; its edge is as soft as requested.
    pub(super) fn of(
        valid: &Plane<u8>,
        silhouette: Option<&Silhouette>,
        rect: Rect,
        options: &'a StackOptions,
        profile: &'a ProfileInput,
    ) -> Self {
        let alpha = match silhouette {
            None => valid.clone(),
            Some(silhouette) => compositing::masked(silhouette.image_alpha(), valid),
        };
        Self { alpha, rect, options, profile }
    }

    /// The RGBA picture of a fused light, which covers the canvas.
    pub(super) fn picture(&self, fused: &Raster) -> Raster {
        let under_alpha = self.options.under_alpha;
        let keep_hidden_colour = under_alpha.is_fused_colour();
        let mut picture = compositing::rgba(fused, &self.alpha, self.rect, self.depth(fused), keep_hidden_colour);
        if under_alpha == UnderAlpha::Pad {
            padding::pad(&mut picture);
        }
        picture
    }

    /// The bit depth of the picture: as requested, or that of the slices. A JPEG has 8 bits.
    pub(super) fn depth(&self, fused: &Raster) -> Depth {
        match self.options.bit_depth {
            BitDepth::Auto if self.options.format == ImageFormat::Jpeg => Depth::Eight,
            BitDepth::Auto => fused.depth(),
            BitDepth::Eight => Depth::Eight,
            BitDepth::Sixteen => Depth::Sixteen,
        }
    }

    /// The metadata of the picture; `source` is that of the reference slice. All slices are mapped to it, so the
    /// picture has its pixels and its principal distance.
    pub(super) fn metadata(&self, source: &Metadata) -> Metadata {
        let number = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let camera = OutputCamera {
            principal_distance_mm: self.profile.principal_distance_mm,
            pixel_pitch_mm: self.profile.pixel_pitch_mm,
            software: SOFTWARE,
        };
        source.for_output(number(self.rect.width), number(self.rect.height), &camera)
    }

    /// The file format of the picture.
    pub(super) fn encoding(&self) -> Encoding {
        Encoding::of(self.options)
    }
}
