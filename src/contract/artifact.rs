//! The result files of jobs: one row per artifact.
//!
//! | artifact | content | stored as | also available as |
//! |---|---|---|---|
//! | `image` | fused image, RGBA | PNG, TIFF or JPEG (option `format`) | PNG, TIFF, JPEG |
//! | `mask` | silhouette, 8-bit grey | PNG | TIFF |
//! | `backlight` | fused back-light stack, grey | PNG | TIFF, JPEG |
//! | `depth` | index of the sharpest slice, 16-bit grey | PNG | TIFF |
//! | `height` | height map, 16-bit grey (option `height`) | PNG | TIFF |
//! | `height-sigma` | standard deviation of the heights, 16-bit grey | PNG | TIFF |
//! | `preview` | small image for web pages | JPEG | |
//! | `overlay-{slice}` | slice of a calibration with the detected dots | PNG | |
//! | `report` | report of a calibration | JSON | |
//!
//! To add an artifact of a stack: a variant, its row in [`StackArtifact::row`], its link in the view and its endpoint.
//! Names and URLs, conversions, and the disk space that a job reserves follow from the row.

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
}

impl FileFormat {
    const ALL: [Self; 4] = [Self::Png, Self::Tiff, Self::Jpeg, Self::Json];

    /// The media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Tiff => "image/tiff",
            Self::Jpeg => "image/jpeg",
            Self::Json => "application/json",
        }
    }

    /// The extension of file names, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Tiff => "tiff",
            Self::Jpeg => "jpg",
            Self::Json => "json",
        }
    }

    /// The format with this media type.
    pub fn of_media_type(media_type: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.media_type() == media_type)
    }
}

/// A result file of a stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StackArtifact {
    /// The fused image.
    Image,
    /// The silhouette.
    Mask,
    /// The fused back-light stack.
    Backlight,
    /// The index of the sharpest slice.
    Depth,
    /// The height map.
    Height,
    /// The standard deviations of the heights.
    HeightSigma,
    /// A small image for web pages.
    Preview,
}

/// What is known about an artifact before a job makes it.
struct Row {
    name: &'static str,
    /// Formats that the file can be converted to on request. Empty: only the stored format is available.
    formats: &'static [FileFormat],
    /// True when only stacks with a back light have it.
    needs_back_light: bool,
    /// True when only stacks with the option `height` have it.
    needs_height: bool,
    /// Bytes per pixel of the canvas, uncompressed.
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

/// Formats of pictures for viewing.
const VIEWABLE: &[FileFormat] = &[FileFormat::Png, FileFormat::Tiff, FileFormat::Jpeg];
/// Formats of data that JPEG would change.
const LOSSLESS: &[FileFormat] = &[FileFormat::Png, FileFormat::Tiff];

impl StackArtifact {
    /// All artifacts of stacks.
    pub const ALL: [Self; 7] =
        [Self::Image, Self::Mask, Self::Backlight, Self::Depth, Self::Height, Self::HeightSigma, Self::Preview];

    fn row(self) -> Row {
        let height_map =
            |name| Row { name, formats: LOSSLESS, needs_back_light: false, needs_height: true, pixel_bytes: |_| 2 };
        match self {
            Self::Image => Row {
                name: "image",
                formats: VIEWABLE,
                needs_back_light: false,
                needs_height: false,
                // RGBA
                pixel_bytes: |sizes| 4 * sizes.image_sample,
            },
            Self::Mask => {
                Row { name: "mask", formats: LOSSLESS, needs_back_light: true, needs_height: false, pixel_bytes: |_| 1 }
            }
            Self::Backlight => Row {
                name: "backlight",
                formats: VIEWABLE,
                needs_back_light: true,
                needs_height: false,
                // an upper bound: it is grey
                pixel_bytes: |sizes| sizes.slice_pixel.max(3),
            },
            Self::Depth => Row {
                name: "depth",
                formats: LOSSLESS,
                needs_back_light: false,
                needs_height: false,
                pixel_bytes: |_| 2,
            },
            Self::Height => height_map("height"),
            Self::HeightSigma => height_map("height-sigma"),
            // its size is bounded, whatever the size of the canvas
            Self::Preview => {
                Row { name: "preview", formats: &[], needs_back_light: false, needs_height: false, pixel_bytes: |_| 0 }
            }
        }
    }

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
        self.row().needs_back_light
    }

    /// True when only stacks with the option `height` have it.
    pub fn needs_height(self) -> bool {
        self.row().needs_height
    }

    /// Bytes per pixel of the canvas, uncompressed; 0 when the size does not depend on the canvas.
    pub fn pixel_bytes(self, sizes: &PixelSizes) -> u64 {
        (self.row().pixel_bytes)(sizes)
    }

    /// The artifact with this name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|artifact| artifact.name() == name)
    }
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
