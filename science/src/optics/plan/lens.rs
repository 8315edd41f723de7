//! The lens of a plan with its f-number and the sensor; the formulas are those of [`crate::types::lens`]. Lengths in
//! mm.

use super::{capture_plan::DepthRange, input::PlanInput};
use crate::types::lens::Lens as Model;

/// Circle of confusion without `coc_um`, pixels.
const COC_PX: f64 = 2.5;

/// A lens and a sensor.
pub(super) struct Lens {
    pub(super) focal: f64,
    f_number: f64,
    pupil_ratio: f64,
    pub(super) wavelength: f64,
    pub(super) coc: f64,
    /// Size of a pixel.
    pub(super) pixel: f64,
}

impl Lens {
    pub(super) fn of(input: &PlanInput) -> Self {
        Self {
            focal: input.focal_mm,
            f_number: input.f_number,
            pupil_ratio: input.pupil_ratio,
            wavelength: input.wavelength_nm * 1e-6,
            coc: input.coc_um.unwrap_or(COC_PX * input.pixel_pitch_um) * 1e-3,
            pixel: input.pixel_pitch_um * 1e-3,
        }
    }

    /// The lens focused at a magnification.
    pub(super) fn at(&self, magnification: f64) -> Model {
        Model { focal_mm: self.focal, magnification, pupil_ratio: self.pupil_ratio }
    }

    pub(super) fn effective_f_number(&self, magnification: f64) -> f64 {
        self.at(magnification).effective_f_number(self.f_number)
    }

    pub(super) fn depth_of_focus(&self, magnification: f64) -> DepthRange {
        let n = self.effective_f_number(magnification);
        DepthRange::of(2.0 * self.coc * n, 4.0 * self.wavelength * n * n)
    }

    pub(super) fn depth_of_field(&self, magnification: f64) -> DepthRange {
        let DepthRange { geometric, wave, .. } = self.depth_of_focus(magnification);
        let square = magnification * magnification;
        DepthRange::of(geometric / square, wave / square)
    }

    /// Blur diameter of a point `distance` from the lens on a sensor at `image_distance`.
    pub(super) fn blur(&self, image_distance: f64, distance: f64) -> f64 {
        self.at(1.0).blur(image_distance, distance, self.f_number)
    }
}
