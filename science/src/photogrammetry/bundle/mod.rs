//! Bundles: the views of a scan as files for a reconstruction program.
//!
//! In: what is known of the scan ([`BundleScan`]). Out: a list of files ([`Entry`]): texts, and references to the
//! images and masks of views, whose bytes stay as they are. One module per program:
//!
//! | layout | masks | intrinsics | poses |
//! |---|---|---|---|
//! | [`colmap`] | `masks/{image}.png` | `sparse/0/cameras.txt` | `sparse/0/images.txt` |
//! | [`meshroom`] | `masks/{stem}.png` | `cameras.sfm` | `cameras.sfm` |
//! | [`metashape`] | `masks/{stem}_mask.png` | `calibration.xml` | `reference.csv` |
//! | [`realitycapture`] | `images/{image}.mask.png` | `images/{stem}.xmp` | `images/{stem}.xmp` |
//! | [`odm`] | `images/{stem}_mask.png` | `opensfm/camera_models_overrides.json` | none: ODM reads positions on the earth only |
//! | [`openmvg`] | `images/{stem}_mask.png` | `sfm_data.json` | `sfm_data.json` |
//! | [`nerfstudio`] | `masks/{stem}.png` | `transforms.json` | `transforms.json` |
//!
//! A mask is white where the object is. Files with a camera exist when the camera is known. Poses exist when every view
//! has pan and tilt; see [`crate::types::view`] for the coordinates.

mod camera;
mod colmap;
mod meshroom;
mod metashape;
mod nerfstudio;
mod odm;
mod openmvg;
mod pose;
mod readme;
mod realitycapture;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::types::{Error, ErrorKind, intrinsics::Intrinsics, view::ViewAngles};

use camera::Camera;
use pose::Pose;

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
    fn file(&self) -> String {
        format!("{}.{}", self.stem, self.extension)
    }
}

/// A file of a bundle.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name with `/` between folders.
    pub path: String,
    /// Its bytes.
    pub content: Content,
}

/// The bytes of a file.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// This text.
    Text(String),
    /// The image of the view with this index.
    Image(usize),
    /// The mask of the view with this index.
    Mask(usize),
}

/// The files of a bundle, `README.txt` first.
///
/// # Errors
/// [`ErrorKind::InvalidParameter`] for a scan without views, and for a view whose image the program takes for a mask.
pub fn plan(layout: Layout, scan: &BundleScan) -> Result<Vec<Entry>, Error> {
    if scan.views.is_empty() {
        return Err(Error::new(ErrorKind::InvalidParameter, "the scan has no views to bundle; send them first"));
    }
    refuse_names_of_masks(layout, scan)?;
    let bundle = Bundle { scan, camera: Camera::of(scan), poses: pose::of(scan) };
    Ok(match layout {
        Layout::Colmap => colmap::files(&bundle),
        Layout::Meshroom => meshroom::files(&bundle),
        Layout::Metashape => metashape::files(&bundle),
        Layout::Realitycapture => realitycapture::files(&bundle),
        Layout::Odm => odm::files(&bundle),
        Layout::Openmvg => openmvg::files(&bundle),
        Layout::Nerfstudio => nerfstudio::files(&bundle),
    })
}

/// ODM and OpenMVG have masks beside the images: `{stem}_mask.png` is the mask of a view, and `mask.png` that of all.
fn refuse_names_of_masks(layout: Layout, scan: &BundleScan) -> Result<(), Error> {
    match layout {
        Layout::Odm | Layout::Openmvg => {}
        Layout::Colmap | Layout::Meshroom | Layout::Metashape | Layout::Realitycapture | Layout::Nerfstudio => {
            return Ok(());
        }
    }
    let is_of_mask = |stem: &str| stem == "mask" || stem.ends_with("_mask");
    match scan.views.iter().find(|view| is_of_mask(&view.stem.to_ascii_lowercase())) {
        None => Ok(()),
        Some(view) => Err(Error::new(
            ErrorKind::InvalidParameter,
            format!(
                "the layout {} has masks named {{view}}_mask.png beside the images, so the image of the view '{}' would be \
                 taken for a mask; give the view another label, or choose another layout",
                layout.name(),
                view.stem
            ),
        )),
    }
}

/// What the layouts are made from.
struct Bundle<'a> {
    scan: &'a BundleScan,
    /// `None` when the principal distance is unknown.
    camera: Option<Camera>,
    /// One per view; `None` unless every view has pan and tilt.
    poses: Option<Vec<Pose>>,
}

impl Bundle<'_> {
    /// Images under `images/`, and masks where `mask` places them.
    fn pictures(&self, mask: impl Fn(&BundleView) -> String) -> Vec<Entry> {
        let views = self.scan.views.iter().enumerate();
        let images = views
            .clone()
            .map(|(at, view)| Entry { path: format!("images/{}", view.file()), content: Content::Image(at) });
        let masks = views.filter(|(_, view)| view.has_mask);
        let masks = masks.map(|(at, view)| Entry { path: mask(view), content: Content::Mask(at) });
        images.chain(masks).collect()
    }

    /// Whether a view has a mask.
    fn has_masks(&self) -> bool {
        self.scan.views.iter().any(|view| view.has_mask)
    }

    /// How many views have no mask.
    fn without_mask(&self) -> usize {
        self.scan.views.iter().filter(|view| !view.has_mask).count()
    }

    /// Views with their poses.
    fn posed(&self) -> impl Iterator<Item = (&BundleView, &Pose)> {
        self.scan.views.iter().zip(self.poses.iter().flatten())
    }
}

fn text(path: &str, text: String) -> Entry {
    Entry { path: path.to_owned(), content: Content::Text(text) }
}

fn json(path: &str, value: &serde_json::Value) -> Entry {
    // a value without maps of other keys than text can always be written
    text(path, serde_json::to_string_pretty(value).unwrap_or_default() + "\n")
}

#[cfg(test)]
mod tests;
