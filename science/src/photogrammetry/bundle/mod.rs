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
mod entries;
mod meshroom;
mod metashape;
mod nerfstudio;
mod odm;
mod openmvg;
mod pose;
mod readme;
mod realitycapture;
mod types;

use crate::types::{Error, ErrorKind};

pub use entries::{Content, Entry};
pub use types::{BundleScan, BundleView, Layout};

use camera::Camera;
use entries::Bundle;

/// The files of a bundle, `README.txt` first.
///
/// # Errors
/// [`ErrorKind::InvalidParameter`] for a scan without views, and for a view whose image the program takes for a mask.
///
/// # Example
/// ```
/// use pinstack_science::photogrammetry::bundle::{self, BundleScan, BundleView, Content, Layout};
///
/// let view = BundleView { stem: "head".into(), extension: "png".into(), bit_depth: 8, has_mask: true, angles: None };
/// let scan = BundleScan {
///     name: "bee".into(), width: 640, height: 480, intrinsics: None, canvas_centre_px: [319.5, 239.5],
///     radius_mm: None, pan_is_clockwise: false, views: vec![view],
/// };
/// let files = bundle::plan(Layout::Meshroom, &scan)?;
/// assert!(files.iter().any(|file| file.path == "masks/head.png" && file.content == Content::Mask(0)));
/// # Ok::<(), pinstack_science::types::Error>(())
/// ```
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

#[cfg(test)]
mod tests;
