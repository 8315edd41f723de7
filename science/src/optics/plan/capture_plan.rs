//! A capture plan: all lengths in mm unless the name says otherwise.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::types::Warning;

/// A capture plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturePlan {
    /// Magnification of the middle of the object.
    pub magnification: f64,
    /// Magnification of the plane in focus in the reference slice: `magnification` of a profile.
    pub reference_magnification: f64,
    /// Distance from the lens to the middle of the object, mm.
    pub object_distance_mm: f64,
    /// Principal distance of the reference slice, mm: `principal_distance_mm` of a profile.
    pub principal_distance_mm: f64,
    /// The same in px.
    pub principal_distance_px: f64,
    /// Effective f-number at the middle of the object.
    pub effective_f_number: f64,
    /// Numerical aperture on the side of the object.
    pub numerical_aperture: f64,
    /// Diameter of the Airy disc on the sensor, micrometres.
    pub airy_um: f64,
    /// Diameter of the circle of confusion in use, micrometres.
    pub coc_um: f64,
    /// Depth of focus at the sensor, mm.
    pub depth_of_focus_mm: DepthRange,
    /// Depth of field at the object, mm.
    pub depth_of_field_mm: DepthRange,
    /// Field of view at the middle of the object, `[width, height]` mm; null without the size of the image.
    pub field_of_view_mm: Option<[f64; 2]>,
    /// Number of slices.
    pub slice_count: u32,
    /// Index of the reference slice, 0-based: the one whose focus is nearest to the middle of the object.
    pub reference_index: u32,
    /// Step of the rail, mm.
    pub step_mm: f64,
    /// Largest step that keeps the overlap, mm.
    pub largest_step_mm: f64,
    /// Contrast of what lies halfway between two slices, as a share of that in focus, for detail at half the Nyquist
    /// frequency of the sensor; null where diffraction leaves no such detail.
    pub contrast_between_slices: Option<f64>,
    /// Travel of the rail, mm.
    pub travel_mm: f64,
    /// Rail position of each slice, mm, increasing towards the object: `rail_positions_mm` of a calibration.
    pub rail_positions_mm: Vec<f64>,
    /// Side of the part of the reference slice that every slice shows, as a share of the whole. Fixed lens only; null
    /// with a moving lens, where it depends on the object.
    pub common_field: Option<f64>,
    /// One entry per slice, the one focused nearest to the camera first.
    pub slices: Vec<PlannedSlice>,
    /// What to consider.
    pub warnings: Vec<Warning>,
}

/// A depth range by geometry and by diffraction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DepthRange {
    /// By the circle of confusion.
    pub geometric: f64,
    /// By diffraction.
    pub wave: f64,
    /// Their sum: what is seen.
    pub total: f64,
}

impl DepthRange {
    pub(super) fn of(geometric: f64, wave: f64) -> Self {
        Self { geometric, wave, total: geometric + wave }
    }
}

/// One slice of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedSlice {
    /// 0-based index.
    pub index: u32,
    /// Rail position, mm, increasing towards the object.
    pub rail_mm: f64,
    /// Distance of the plane in focus from the nearest point of the object, mm.
    pub depth_mm: f64,
    /// Magnification of the plane in focus.
    pub magnification: f64,
    /// Scale from this slice to the reference slice: of the homography. With a moving lens, that of the plane in focus
    /// in the reference slice.
    pub scale: f64,
    /// Brightness over that of the reference slice; `gain` is its reciprocal.
    pub exposure_ratio: f64,
    /// Blur radius of a target that is in focus in the reference slice, px.
    pub target_blur_px: f64,
}
