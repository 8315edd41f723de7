//! The truth of the demo's stack, and the comparison of the results with it.

use anyhow::{Context, Result};
use serde_json::Value;

use super::compare::{iou, psnr, worst_corner_px};
use pinstack_science::{
    imaging::{Plane, Raster, Samples, warp::Warp},
    synth::{Light, Rig, Stage, Truth},
    types::Homography,
};

/// What the demo is rendered from.
pub(super) struct Known {
    /// The camera on its rail.
    pub rig: Rig,
    /// The scene with the object.
    pub stage: Stage,
}

/// The comparison of the results with the truth.
pub(super) struct Score {
    worst_corner_px: f64,
    worst_rms_px: f64,
    /// PSNR of the fused image on the object, dB.
    pub psnr_fused: f64,
    psnr_single: f64,
    best_single: usize,
    /// Intersection over union of the mask.
    pub iou: f64,
    /// The first slice, for the contact sheet.
    pub first_slice: Raster,
    /// The last slice, for the contact sheet.
    pub last_slice: Raster,
    /// The all-in-focus truth.
    pub truth: Raster,
    /// Four times the absolute difference from the truth.
    pub difference: Raster,
}

impl Known {
    /// Compares a profile, a fused image and a mask with the truth.
    ///
    /// # Errors
    /// When the profile lacks its homographies.
    pub(super) fn score(&self, profile: &Value, image: &Raster, mask: &Raster) -> Result<Score> {
        let Truth { sharp, mask: true_mask, .. } = self.stage.truth();
        let measured: Vec<Homography> =
            serde_json::from_value(profile["homographies"].clone()).context("the profile has homographies")?;
        let true_homographies: Vec<Homography> = (0..self.rig.slices()).map(|i| self.rig.homography(i)).collect();
        let (width, height) = (self.rig.width as u32, self.rig.height as u32);
        let rms = profile["slices"].as_array().into_iter().flatten().filter_map(|slice| slice["rms_px"].as_f64());

        let slices: Vec<Raster> = (0..self.rig.slices()).map(|i| self.stage.render(Light::Front, i)).collect();
        let singles = slices.iter().enumerate().filter_map(|(i, slice)| {
            let (warped, covered) = warped(slice, &true_homographies[i], self.rig.gain(i))?;
            let inside = Plane {
                data: true_mask.data.iter().zip(&covered.data).map(|(object, covered)| object & covered).collect(),
                ..true_mask
            };
            Some((i, psnr(&warped, &sharp, &inside)))
        });
        let (best_single, psnr_single) = singles.max_by(|a, b| a.1.total_cmp(&b.1)).context("a stack has slices")?;
        let Samples::Eight(alpha) = &mask.samples else { anyhow::bail!("the mask has 8 bits") };
        Ok(Score {
            worst_corner_px: worst_corner_px(&measured, &true_homographies, width, height),
            worst_rms_px: rms.fold(0.0, f64::max),
            psnr_fused: psnr(image, &sharp, &true_mask),
            psnr_single,
            best_single,
            iou: iou(alpha, &true_mask.data),
            first_slice: slices[0].clone(),
            last_slice: slices[slices.len() - 1].clone(),
            difference: difference(image, &sharp, &true_mask),
            truth: sharp,
        })
    }
}

impl Score {
    /// The numbers as text for the terminal.
    pub(super) fn table(&self) -> String {
        [
            format!(
                "homographies  worst image corner {:.3} px from the truth (dots: worst RMS {:.3} px)",
                self.worst_corner_px, self.worst_rms_px
            ),
            format!("fused image   {:.2} dB on the object against the all-in-focus truth", self.psnr_fused),
            format!("best slice    {:.2} dB (slice {})", self.psnr_single, self.best_single),
            format!("mask          IoU {:.4}", self.iou),
        ]
        .join("\n")
    }
}

/// A slice on the reference slice's canvas, and which pixels it covers there (255).
fn warped(slice: &Raster, homography: &Homography, gain: f64) -> Option<(Raster, Plane<u8>)> {
    let size = (slice.width, slice.height);
    let warp = Warp::new(homography, gain, size, size)?;
    let samples = match &slice.samples {
        Samples::Eight(samples) => Samples::Eight(warp.apply(samples.clone(), slice.channels)),
        Samples::Sixteen(samples) => Samples::Sixteen(warp.apply(samples.clone(), slice.channels)),
    };
    let covered = warp.coverage().mask(pinstack_science::imaging::Rect::whole(size.0, size.1));
    Some((Raster { samples, ..*slice }, covered))
}

/// Four times the absolute difference of the colours on the object.
fn difference(image: &Raster, truth: &Raster, object: &Plane<u8>) -> Raster {
    let (Samples::Eight(a), Samples::Eight(b)) = (&image.samples, &truth.samples) else { return truth.clone() };
    let pixels = object.data.iter().enumerate().flat_map(|(i, object)| {
        [0, 1, 2].map(|c| {
            let distance = a[i * image.channels + c].abs_diff(b[i * truth.channels + c]);
            if *object == 0 { 0 } else { distance.saturating_mul(4) }
        })
    });
    Raster::eight(truth.width, truth.height, 3, pixels.collect())
}
