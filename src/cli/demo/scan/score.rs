//! The comparison of a fused scan with the truth.

use anyhow::{Context, Result};
use serde::Serialize;
use serde_json::Value;

use super::{
    super::compare::{iou, psnr, worst_corner_px},
    setup::Setup,
};
use pinstack_science::{
    imaging::{Plane, Raster, Samples},
    photogrammetry::poses::{self, PoseFormat},
    types::{Homography, view::ViewAngles},
};

/// How good the scan is. Written to `figures.json`.
#[derive(Debug, Serialize)]
pub(super) struct Figures {
    /// Verdict of the calibration in one word.
    pub grade: String,
    /// Largest distance of an image corner mapped by the measured and by the true homographies, px.
    pub worst_corner_px: f64,
    /// Measured principal distance of the reference slice, mm.
    pub principal_distance_mm: f64,
    /// True principal distance of the reference slice, mm.
    pub true_principal_distance_mm: f64,
    /// The fused views against the truth.
    pub views: Vec<ViewFigures>,
    /// Names of the views that were outliers at first.
    pub outliers: Vec<String>,
    /// Name of the view whose stack has a fault.
    pub knocked: String,
    /// PSNR of that view before it was photographed again, dB.
    pub knocked_psnr_db: f64,
    /// Names of the views that are outliers after that.
    pub outliers_after_retake: Vec<String>,
    /// Views with a pose in the bundle.
    pub poses: usize,
    /// Largest distance of a centre of projection in the bundle from the true one, mm.
    pub worst_centre_mm: f64,
}

/// A fused view against the truth.
#[derive(Debug, Serialize)]
pub(super) struct ViewFigures {
    /// Its name.
    pub name: String,
    /// PSNR of the fused image on the object, dB.
    pub psnr_db: f64,
    /// Intersection over union of the mask.
    pub iou: f64,
}

impl ViewFigures {
    /// Compares an image and a mask of the service with those of the ideal camera.
    pub(super) fn of(name: &str, fused: &Pictures, truth: &Pictures) -> Result<Self> {
        let inside = truth.mask()?;
        let found = fused.mask()?;
        Ok(Self {
            name: name.to_owned(),
            psnr_db: psnr(&fused.image, &truth.image, &inside),
            iou: iou(&found.data, &inside.data),
        })
    }
}

/// Image and mask of a view.
pub(super) struct Pictures {
    /// The object.
    pub image: Raster,
    /// Grey, white where the object is.
    pub mask: Raster,
}

impl Pictures {
    fn mask(&self) -> Result<Plane<u8>> {
        let Samples::Eight(samples) = &self.mask.samples else { anyhow::bail!("a mask has 8 bits") };
        let data = samples.iter().step_by(self.mask.channels).copied().collect();
        Ok(Plane { width: self.mask.width, height: self.mask.height, data })
    }
}

/// Largest distance of a corner in px, and the principal distance in mm, of the profile.
///
/// # Errors
/// When the profile lacks homographies or the principal distance.
pub(super) fn of_profile(setup: &Setup, profile: &Value) -> Result<(f64, f64)> {
    let measured: Vec<Homography> =
        serde_json::from_value(profile["homographies"].clone()).context("the profile has homographies")?;
    let truth: Vec<Homography> = (0..setup.rig.slices()).map(|i| setup.rig.homography(i)).collect();
    let distance = profile["principal_distance_mm"].as_f64().context("the profile has the principal distance")?;
    let (width, height) = (setup.rig.width as u32, setup.rig.height as u32);
    Ok((worst_corner_px(&measured, &truth, width, height), distance))
}

/// How many views have a pose in COLMAP's `images.txt`, and the largest distance of a centre of projection from the
/// true one, mm.
///
/// # Errors
/// When the file cannot be read, or names a view without angles.
pub(super) fn of_poses(setup: &Setup, images: &[u8]) -> Result<(usize, f64)> {
    let found = poses::read(images, Some(PoseFormat::ColmapText))?;
    let mut worst: f64 = 0.0;
    for pose in &found.poses {
        let angles = ViewAngles::of_name(&pose.name).with_context(|| format!("{} has no angles", pose.name))?;
        let squared = pose.centre.iter().zip(angles.direction());
        let squared: f64 = squared.map(|(found, truth)| (found - setup.radius_mm() * truth).powi(2)).sum();
        worst = worst.max(squared.sqrt());
    }
    Ok((found.poses.len(), worst))
}

impl Figures {
    /// The numbers as text for the terminal.
    pub(super) fn table(&self) -> String {
        let mean = |value: fn(&ViewFigures) -> f64| self.views.iter().map(value).sum::<f64>() / self.views.len() as f64;
        let least = |value: fn(&ViewFigures) -> f64| {
            let worst = self.views.iter().min_by(|a, b| value(a).total_cmp(&value(b)));
            worst.map_or_else(String::new, |view| format!("{:.4} in {}", value(view), view.name))
        };
        let named = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        [
            format!(
                "calibration   {}: worst image corner {:.3} px from the truth; principal distance {:.3} mm, truly {:.3} mm",
                self.grade, self.worst_corner_px, self.principal_distance_mm, self.true_principal_distance_mm
            ),
            format!(
                "outliers      {}; the rig was knocked in {} ({:.1} dB); after it was photographed again: {}",
                named(&self.outliers),
                self.knocked,
                self.knocked_psnr_db,
                named(&self.outliers_after_retake)
            ),
            format!(
                "fused views   {}: {:.2} dB on the object against the all-in-focus truth (mean), least {}",
                self.views.len(),
                mean(|view| view.psnr_db),
                least(|view| view.psnr_db)
            ),
            format!("masks         IoU {:.4} (mean), least {}", mean(|view| view.iou), least(|view| view.iou)),
            format!("bundle        {} poses, at most {:.6} mm from the truth", self.poses, self.worst_centre_mm),
        ]
        .join("\n")
    }
}
