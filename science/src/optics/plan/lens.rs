//! The lens of a plan. Lengths in mm.

use super::{capture_plan::DepthRange, input::PlanInput};

/// Circle of confusion without `coc_um`, pixels.
const COC_PX: f64 = 2.5;

/// A lens and a sensor.
pub(super) struct Lens {
    pub(super) focal: f64,
    f_number: f64,
    /// Diameter of the exit pupil over that of the entrance pupil.
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

    pub(super) fn effective_f_number(&self, magnification: f64) -> f64 {
        self.f_number * (1.0 + magnification / self.pupil_ratio)
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

    /// Distance from the lens to the plane in focus: `f (1 + 1/M)`.
    pub(super) fn object_distance(&self, magnification: f64) -> f64 {
        self.focal * (1.0 + 1.0 / magnification)
    }

    /// Distance from the entrance pupil, the centre of projection, to the plane in focus: `f (1/M + 1/P)`.
    pub(super) fn pupil_distance(&self, magnification: f64) -> f64 {
        self.focal * (1.0 / magnification + 1.0 / self.pupil_ratio)
    }

    /// Principal distance of the pinhole camera: `f (1 + M/P)`.
    pub(super) fn principal_distance(&self, magnification: f64) -> f64 {
        self.focal * (1.0 + magnification / self.pupil_ratio)
    }

    /// The other conjugate distance.
    pub(super) fn conjugate(&self, distance: f64) -> f64 {
        self.focal * distance / (distance - self.focal)
    }

    /// Size of the image of a fixed lens at one magnification over that at another: `(M + P) / (M' + P)`.
    pub(super) fn growth(&self, magnification: f64, other: f64) -> f64 {
        (magnification + self.pupil_ratio) / (other + self.pupil_ratio)
    }

    /// Blur diameter of a point `distance` from the lens on a sensor at `image_distance`:
    /// `|d2 - d2'| / N_eff'` with `d2' = f s / (s - f)`, free of the pole at `s = f`.
    pub(super) fn blur(&self, image_distance: f64, distance: f64) -> f64 {
        let beyond = distance - self.focal;
        let from_pupil = beyond + self.focal / self.pupil_ratio;
        (image_distance * beyond - self.focal * distance).abs() / (self.f_number * from_pupil)
    }
}
