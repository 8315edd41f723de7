//! The result files of jobs.
//!
//! A file of a stack is a row of [`stack_artifacts`], from which all but its picture (`jobs/pictures.rs`) follows, or
//! `lights/{name}`, a further light, which is treated as the image is. A calibration has `overlay-{slice}`, a slice
//! with the detected dots as PNG, and `report`, JSON. The files of
//! a reconstruction are in [`super::reconstruction::files`].

use super::outcome::Artifact;

/// A file format of artifacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FileFormat {
    /// PNG.
    Png,
    /// TIFF.
    Tiff,
    /// JPEG.
    Jpeg,
    /// JSON.
    Json,
    /// Points with colours, PLY.
    Ply,
    /// A mesh, glTF in one file.
    Glb,
    /// A zip.
    Zip,
    /// UTF-8 text.
    Text,
}

impl FileFormat {
    const ALL: [Self; 8] = [Self::Png, Self::Tiff, Self::Jpeg, Self::Json, Self::Ply, Self::Glb, Self::Zip, Self::Text];

    /// The media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Tiff => "image/tiff",
            Self::Jpeg => "image/jpeg",
            Self::Json => "application/json",
            Self::Ply => "application/octet-stream",
            Self::Glb => "model/gltf-binary",
            Self::Zip => "application/zip",
            Self::Text => "text/plain; charset=utf-8",
        }
    }

    /// The extension of file names, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Tiff => "tiff",
            Self::Jpeg => "jpg",
            Self::Json => "json",
            Self::Ply => "ply",
            Self::Glb => "glb",
            Self::Zip => "zip",
            Self::Text => "txt",
        }
    }

    /// The format with this media type.
    pub fn of_media_type(media_type: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.media_type() == media_type)
    }
}

/// How the viewer of the web pages colours a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Colours {
    /// The samples are the colours.
    Plain,
    /// A colour per index, from the first slice to the last; the largest value means none.
    Indices,
    /// A colour per height, from the lowest to the highest; 0 means none.
    Heights,
}

/// What a stack must have so that its job makes an artifact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Needs {
    Nothing,
    BackLight,
    /// The option `height`.
    Height,
}

/// Formats of pictures for viewing.
const VIEWABLE: &[FileFormat] = &[FileFormat::Png, FileFormat::Tiff, FileFormat::Jpeg];
/// Formats of data that JPEG would change.
const LOSSLESS: &[FileFormat] = &[FileFormat::Png, FileFormat::Tiff];
/// Only the stored format is available.
const AS_STORED: &[FileFormat] = &[];

/// Calls a macro with the artifacts of stacks, one row each: the variant of [`StackArtifact`] and the member of the
/// links of a stack, then
///
/// | column | what it is |
/// |---|---|
/// | `name` | name of the file, and last segment of its URL |
/// | `link` | what it is, for the links of a stack |
/// | `summary`, `description`, `absent` | documentation of its endpoint; `absent`: why there may be none |
/// | `formats` | `VIEWABLE`, `LOSSLESS` or `AS_STORED`: formats that it can be converted to |
/// | `needs` | what the stack must have |
/// | `layer` | its name and colours in the viewer |
/// | `pixel_bytes` | bytes per pixel of the canvas, uncompressed |
macro_rules! stack_artifacts {
    ($then:ident) => {
        $then! {
            Image image {
                name: "image",
                link: "The fused image, RGBA.",
                summary: "Get the fused image",
                description: "RGBA with straight alpha; RGB without alpha as JPEG. The file is stored in the `format` of \
                    the stack. `Accept`\nselects another format: the file is then converted on request, with the same \
                    pixels, colour profile and EXIF.\n`HEAD` does not convert, so it sends no `Content-Length` for a \
                    file that is not converted yet.",
                absent: "`not_found`; `no_result`: the stack failed or was cancelled",
                formats: VIEWABLE,
                needs: Nothing,
                layer: Some(("Image", Colours::Plain)),
                // RGBA
                pixel_bytes: |sizes| 4 * sizes.image_sample,
            }
            Mask mask {
                name: "mask",
                link: "The alpha mask.",
                summary: "Get the mask",
                description: "8-bit grey PNG: 255 object, 0 background. TIFF with `Accept: image/tiff`.",
                absent: "`not_found`; `no_result`: the stack failed, was cancelled, or has no mask",
                formats: LOSSLESS,
                needs: BackLight,
                layer: Some(("Mask", Colours::Plain)),
                pixel_bytes: |_| 1,
            }
            Backlight backlight {
                name: "backlight",
                link: "The fused back-light stack.",
                summary: "Get the fused back-light stack",
                description: "The image from which the mask is made. PNG; TIFF or JPEG with `Accept`.",
                absent: "`not_found`; `no_result`: the stack failed, was cancelled, or has no back light",
                formats: VIEWABLE,
                needs: BackLight,
                layer: Some(("Back light", Colours::Plain)),
                // an upper bound: it is grey
                pixel_bytes: |sizes| sizes.slice_pixel.max(3),
            }
            Depth depth {
                name: "depth",
                link: "The slice-index map.",
                summary: "Get the slice-index map",
                description: "16-bit grey PNG: 0-based index of the sharpest slice per pixel; 65535 where no slice covers \
                    the pixel. TIFF with\n`Accept: image/tiff`.",
                absent: "`not_found`; `no_result`: the stack failed or was cancelled",
                formats: LOSSLESS,
                needs: Nothing,
                layer: Some(("Sharpest slice", Colours::Indices)),
                pixel_bytes: |_| 2,
            }
            Height height {
                name: "height",
                link: "The height map.",
                summary: "Get the height map",
                description: "16-bit grey PNG of a stack with `height=auto`. A value `v` above 0 is the height `offset + \
                    (v - 1) scale`; the\nmember `height` of the stack has both numbers and their unit. 0 where the \
                    height is unknown. TIFF with\n`Accept: image/tiff`.",
                absent: "`not_found`; `no_result`: the stack failed, was cancelled, or was fused with `height=none`",
                formats: LOSSLESS,
                needs: Height,
                layer: Some(("Height", Colours::Heights)),
                pixel_bytes: |_| 2,
            }
            HeightSigma height_sigma {
                name: "height-sigma",
                link: "The standard deviations of the heights.",
                summary: "Get the standard deviations of the heights",
                description: "16-bit grey PNG of a stack with `height=auto`: a value times `height.scale` is the standard \
                    deviation of the\nheight of the pixel. 0 where the height is unknown. TIFF with `Accept: \
                    image/tiff`.",
                absent: "`not_found`; `no_result`: the stack failed, was cancelled, or was fused with `height=none`",
                formats: LOSSLESS,
                needs: Height,
                layer: Some(("Height uncertainty", Colours::Heights)),
                pixel_bytes: |_| 2,
            }
            Preview preview {
                name: "preview",
                link: "A small JPEG for web pages.",
                summary: "Get a small image for web pages",
                description: "JPEG of at most 800 px per side. Transparent pixels are shown on light grey. Stacks of older \
                    versions have a\nPNG. This file is not converted.",
                absent: "`not_found`; `no_result`: the stack failed or was cancelled",
                formats: AS_STORED,
                needs: Nothing,
                layer: None,
                // its size is bounded, whatever the size of the canvas
                pixel_bytes: |_| 0,
            }
        }
    };
}
pub(crate) use stack_artifacts;

/// What is known about an artifact before a job makes it.
struct Row {
    name: &'static str,
    formats: &'static [FileFormat],
    needs: Needs,
    layer: Option<(&'static str, Colours)>,
    pixel_bytes: fn(&PixelSizes) -> u64,
}

/// What the size of an artifact depends on.
#[derive(Debug, Clone, Copy)]
pub struct PixelSizes {
    /// Bytes per sample of the image: 1 or 2.
    pub image_sample: u64,
    /// Bytes per pixel of a slice, over all channels.
    pub slice_pixel: u64,
}

macro_rules! variants {
    ($($variant:ident $member:ident {
        name: $name:tt, link: $link:tt, summary: $_s:tt, description: $_d:tt, absent: $_a:tt, formats: $formats:ident,
        needs: $needs:ident, layer: $layer:expr, pixel_bytes: $pixel_bytes:expr,
    })*) => {
        /// A result file of a stack.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum StackArtifact {
            $(#[doc = $link] $variant,)*
        }

        impl StackArtifact {
            /// All artifacts of stacks.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            fn row(self) -> Row {
                match self {
                    $(Self::$variant => Row {
                        name: $name,
                        formats: $formats,
                        needs: Needs::$needs,
                        layer: $layer,
                        pixel_bytes: $pixel_bytes,
                    },)*
                }
            }
        }
    };
}
stack_artifacts!(variants);

impl StackArtifact {
    /// Its name, in rows and as the last segment of its URL.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Formats that the file can be converted to on request. Empty: only the stored format is available.
    pub fn formats(self) -> &'static [FileFormat] {
        self.row().formats
    }

    /// True when only stacks with a back light have it.
    pub fn needs_back_light(self) -> bool {
        self.row().needs == Needs::BackLight
    }

    /// True when only stacks with the option `height` have it.
    pub fn needs_height(self) -> bool {
        self.row().needs == Needs::Height
    }

    /// Its name and its colours in the viewer; `None` when it is not shown there.
    pub fn layer(self) -> Option<(&'static str, Colours)> {
        self.row().layer
    }

    /// Bytes per pixel of the canvas, uncompressed; 0 when the size does not depend on the canvas.
    pub fn pixel_bytes(self, sizes: &PixelSizes) -> u64 {
        (self.row().pixel_bytes)(sizes)
    }

    /// The artifact with this name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|artifact| artifact.name() == name)
    }

    /// The stored file of this artifact among the files of a stack.
    pub fn among(self, files: &[Artifact]) -> Option<&Artifact> {
        files.iter().find(|file| file.name == self.name())
    }
}

/// Begins the name of the picture of a further light.
const LIGHT_PREFIX: &str = "lights/";

/// Formats that the picture of a further light can be converted to: those of the image.
pub const LIGHT_FORMATS: &[FileFormat] = VIEWABLE;

/// Name of the picture of a further light of a stack; also the end of its URL.
pub fn light_name(light: &str) -> String {
    format!("{LIGHT_PREFIX}{light}")
}

/// The further light that the name of a picture contains.
pub fn light_of(name: &str) -> Option<&str> {
    name.strip_prefix(LIGHT_PREFIX)
}

/// Name of the report of a calibration.
pub const REPORT: &str = "report";

const OVERLAY_PREFIX: &str = "overlay-";

/// Name of the overlay of a slice (0-based).
pub fn overlay_name(slice: usize) -> String {
    format!("{OVERLAY_PREFIX}{slice}")
}

/// The slice that the name of an overlay contains.
pub fn overlay_slice(name: &str) -> Option<&str> {
    name.strip_prefix(OVERLAY_PREFIX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_media_types_lead_back_to_their_rows() {
        for artifact in StackArtifact::ALL {
            assert_eq!(StackArtifact::of_name(artifact.name()), Some(artifact));
        }
        assert_eq!(StackArtifact::of_name(REPORT), None);
        for format in FileFormat::ALL {
            assert_eq!(FileFormat::of_media_type(format.media_type()), Some(format));
        }
        assert_eq!(overlay_slice(&overlay_name(12)), Some("12"));
    }
}
