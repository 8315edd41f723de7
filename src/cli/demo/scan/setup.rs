//! What the scan is rendered from: a rig, a specimen, the views, and one view whose stack has a fault.

use crate::cli::demo::files::TARGET_COLUMNS;
use pinstack_science::{
    photogrammetry::bundle::{BundleScan, BundleView},
    synth::{
        DotTarget, Rig, Stage,
        turntable::{self, Specimen},
    },
    types::{intrinsics::Intrinsics, view::ViewAngles},
};

// the name used in docs/TUTORIAL.md
pub(super) const SCAN: &str = "beetle";

/// How far the rig is knocked in the view with a fault, px of a picture 600 px wide.
const KNOCK_PX: [f64; 2] = [4.0, -2.5];

/// A scan with known truth.
#[derive(Debug, Clone)]
pub(super) struct Setup {
    /// The camera on its rail.
    pub rig: Rig,
    /// The object.
    pub specimen: Specimen,
    /// The views, at least one, by tilt and pan.
    pub views: Vec<ViewAngles>,
}

impl Setup {
    /// Views at every combination of `pans` equal steps around the axis and the tilts, degrees.
    pub(super) fn new(width: usize, slices: usize, pans: u32, tilts: &[f64], seed: u64) -> Self {
        let ring = |tilt_deg: f64| {
            (0..pans).map(move |pan| ViewAngles { pan_deg: 360.0 * f64::from(pan) / f64::from(pans), tilt_deg })
        };
        Self {
            rig: Rig { seed, ..turntable::scan_rig(width, slices) },
            specimen: Specimen::beetle(seed),
            views: tilts.iter().flat_map(|&tilt| ring(tilt)).collect(),
        }
    }

    /// The dot target that the rig is calibrated with. No edge of it is in view, so its dots carry a code.
    pub(super) fn target(&self) -> DotTarget {
        DotTarget { code: Some([0, 0]), ..DotTarget::for_rig(&self.rig, TARGET_COLUMNS) }
    }

    /// Distance from the camera to the point where the axes of pan and tilt meet, mm.
    pub(super) fn radius_mm(&self) -> f64 {
        turntable::scan_radius(&self.rig)
    }

    /// The object as the rig sees it.
    pub(super) fn stage(&self, angles: ViewAngles) -> Stage {
        turntable::view(&self.rig, &self.specimen, angles)
    }

    /// The view during whose stack the rig is knocked: two thirds through the scan.
    pub(super) fn knocked_view(&self) -> ViewAngles {
        self.views[self.views.len() * 2 / 3]
    }

    /// The first slice after the knock. The reference slice is before it.
    pub(super) fn knocked_from(&self) -> usize {
        (self.rig.reference + 1).min(self.rig.slices() - 1)
    }

    /// The same view with a rig that is knocked in the middle of the stack and does not come back.
    pub(super) fn knocked_stage(&self) -> Stage {
        let scale = self.rig.width as f64 / 600.0;
        let mut displaced_px = vec![[0.0; 2]; self.knocked_from()];
        displaced_px.resize(self.rig.slices(), KNOCK_PX.map(|px| px * scale));
        let rig = Rig { displaced_px, ..self.rig.clone() };
        turntable::view(&rig, &self.specimen, self.knocked_view())
    }

    /// The scan as an ideal camera would have taken it, for a bundle with the true camera and poses.
    pub(super) fn ideal(&self) -> BundleScan {
        let distance_mm = self.rig.principal_distance(self.rig.reference);
        let view = |&angles: &ViewAngles| BundleView {
            stem: angles.file_stem(),
            extension: "png".into(),
            bit_depth: 8,
            has_mask: true,
            angles: Some(angles),
        };
        BundleScan {
            name: SCAN.into(),
            width: self.rig.width as u32,
            height: self.rig.height as u32,
            intrinsics: Some(Intrinsics {
                principal_distance_px: distance_mm / self.rig.pixel_pitch_mm,
                principal_distance_mm: distance_mm,
                principal_distance_sigma_mm: Some(0.0),
                pixel_pitch_mm: self.rig.pixel_pitch_mm,
                principal_point_px: None,
                distortion: None,
            }),
            canvas_centre_px: self.rig.centre(),
            radius_mm: Some(self.radius_mm()),
            pan_is_clockwise: false,
            views: self.views.iter().map(view).collect(),
        }
    }
}
