//! What a bundle is made from: the scan and its views, and the program that the bundle is for.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::types::{intrinsics::Intrinsics, view::ViewAngles};

/// The program that a bundle is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// COLMAP.
    Colmap,
    /// Meshroom and AliceVision.
    Meshroom,
    /// Agisoft Metashape.
    Metashape,
    /// RealityCapture.
    Realitycapture,
    /// OpenDroneMap.
    Odm,
    /// OpenMVG.
    Openmvg,
    /// nerfstudio.
    Nerfstudio,
}

impl Layout {
    /// All layouts.
    pub const ALL: [Self; 7] = [
        Self::Colmap,
        Self::Meshroom,
        Self::Metashape,
        Self::Realitycapture,
        Self::Odm,
        Self::Openmvg,
        Self::Nerfstudio,
    ];

    /// Its name in the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Meshroom => "meshroom",
            Self::Metashape => "metashape",
            Self::Realitycapture => "realitycapture",
            Self::Odm => "odm",
            Self::Openmvg => "openmvg",
            Self::Nerfstudio => "nerfstudio",
        }
    }
}

/// A scan, all images of which are of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleScan {
    /// Name of the scan.
    pub name: String,
    /// Width of every image, px.
    pub width: u32,
    /// Height of every image, px.
    pub height: u32,
    /// The common camera, if it is known.
    pub intrinsics: Option<Intrinsics>,
    /// Centre of the uncropped image in these images, `[x, y]` px: the principal point where none is known.
    pub canvas_centre_px: [f64; 2],
    /// Distance from the centre of projection to the point where the axes of pan and tilt meet, mm.
    pub radius_mm: Option<f64>,
    /// With growing pan the camera moves clockwise around the object, seen from above.
    pub pan_is_clockwise: bool,
    /// The views, at least one.
    pub views: Vec<BundleView>,
}

/// A view of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleView {
    /// Name of its files, without extension: unique, without dots and blanks.
    pub stem: String,
    /// Extension of the image, without a dot.
    pub extension: String,
    /// Bits per sample of the image, 8 or 16.
    pub bit_depth: u8,
    /// Whether it has a mask (PNG, 8 bits, white where the object is).
    pub has_mask: bool,
    /// Pan and tilt as commanded.
    pub angles: Option<ViewAngles>,
}

impl BundleView {
    /// File name of the image.
    pub(super) fn file(&self) -> String {
        format!("{}.{}", self.stem, self.extension)
    }
}
