//! The lens of a plan with its f-number and the sensor; the formulas are those of [`crate::types::lens`]. Lengths in
//! mm.

use std::f64::consts::PI;

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

    /// Contrast at half the Nyquist frequency of the sensor when it is `defocus` out of focus, as a share of that in
    /// focus; none beyond the cut-off frequency.
    pub(super) fn contrast(&self, magnification: f64, defocus: f64) -> Option<f64> {
        let n = self.effective_f_number(magnification);
        let transfer = Transfer { shift: 2.0 * self.wavelength * n / (4.0 * self.pixel) };
        let path = defocus / (8.0 * n * n) / self.wavelength;
        (transfer.shift < 2.0).then(|| (transfer.at(path) / transfer.at(0.0)).max(0.0))
    }

    /// Blur diameter of a point `distance` from the lens on a sensor at `image_distance`.
    pub(super) fn blur(&self, image_distance: f64, distance: f64) -> f64 {
        self.at(1.0).blur(image_distance, distance, self.f_number)
    }
}

/// The optical transfer function of a lens with a circular pupil, out of focus (H. H. Hopkins, Proc. R. Soc. A 231,
/// 1955), at one frequency.
struct Transfer {
    /// The frequency `s`, which is also the shift of the pupil against itself, in radii: 2 is the cut-off.
    shift: f64,
}

impl Transfer {
    /// Steps of the integral.
    const STEPS: usize = 2000;

    /// `1/pi` times the integral of `2 sqrt(1 - (|x| + s/2)^2) cos(4 pi w s x)` over the `x` at which the root is real.
    /// `path` is `w`, the defocus at the edge of the pupil in wavelengths.
    fn at(&self, path: f64) -> f64 {
        let reach = 1.0 - self.shift / 2.0;
        let width = reach / Self::STEPS as f64;
        let value = |i: usize| {
            let x = (i as f64 + 0.5) * width;
            let chord = 2.0 * (1.0 - (x + self.shift / 2.0).powi(2)).max(0.0).sqrt();
            chord * (4.0 * PI * path * self.shift * x).cos()
        };
        // the integrand is even
        2.0 * width * (0..Self::STEPS).map(value).sum::<f64>() / PI
    }
}
