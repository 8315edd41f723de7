//! The camera on its rail: a lens with two pupils, a sensor, and their imperfections.

use nalgebra::Matrix3;

use super::noise::{between, key};
use crate::imaging::Depth;
use crate::types::{Homography, lens::Lens, profile::CaptureMode};

/// A lens, a sensor and a rail; the formulas are those of [`Lens`]. All lengths in mm, all image coordinates in px with
/// the centre of the top-left pixel at (0, 0).
///
/// Depth is a *fraction* 0..1: depth 0 is in focus in the first slice, depth 1 in the last, and the rail position is
/// linear between them. In the rigs of [`Rig::sized`], [`Rig::moving_lens`] and `scan_rig`
/// the first slice is focused nearest to the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// What moves.
    pub mode: CaptureMode,
    /// Focal length f.
    pub focal_mm: f64,
    /// Pupil ratio P: diameter of the exit pupil over that of the entrance pupil.
    pub pupil_ratio: f64,
    /// f-number N: the entrance pupil is f / N wide.
    pub f_number: f64,
    /// Distance of neighbouring pixels on the sensor.
    pub pixel_pitch_mm: f64,
    /// Image width in px.
    pub width: usize,
    /// Image height in px.
    pub height: usize,
    /// Magnification M of what is in focus in the reference slice.
    pub magnification: f64,
    /// One per slice, at least one, strictly rising or falling. Fixed lens: sensor offset, d2 of slice i is d2 of the
    /// reference + `rail_mm[i] - rail_mm[reference]`, positive away from the lens (the opposite of
    /// `ProfileInput::rail_positions_mm`). Moving lens: advance of the camera towards the object. Lens alone: advance
    /// of the lens towards the object; not at a magnification of 1, where the plane in focus does not move.
    pub rail_mm: Vec<f64>,
    /// Index of the reference slice.
    pub reference: usize,
    /// In-plane drift of the image, px over the whole rail (plus a jitter of up to a tenth of it per slice).
    pub drift_px: [f64; 2],
    /// One per slice: further displacement of the image, px: jumps, backlash, steady drift. A slice without entry has
    /// none; that of the reference is subtracted from all.
    pub displaced_px: Vec<[f64; 2]>,
    /// A slice that the camera sees otherwise than the others.
    pub alone: Option<Alone>,
    /// Rotation of the image about its centre over the whole rail, degrees.
    pub rotation_deg: f64,
    /// Keystone over the whole rail: how much larger the right (bottom) border gets than the centre,
    /// as a fraction.
    pub keystone: [f64; 2],
    /// Light lost in the corners, 0..1; it falls with the square of the distance from the centre.
    pub vignetting: f64,
    /// Whether the light per pixel falls with the square of the sensor distance, as in reality.
    pub exposure_falls: bool,
    /// Standard deviation of the point spread in focus, px (diffraction, low-pass filter, demosaicing). 0: each pixel
    /// integrates its own square only, which no real camera does.
    pub softness_px: f64,
    /// Standard deviation of the noise, in units of an 8-bit picture (of 255).
    pub noise: f64,
    /// Bits per sample.
    pub depth: Depth,
    /// 1 grey, 3 RGB.
    pub channels: usize,
    /// Seed of the noise and of the drift jitter.
    pub seed: u64,
}

/// How the image of one slice differs, about its centre.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Alone {
    /// Index of the slice; not the reference.
    pub slice: usize,
    /// Keystone, as [`Rig::keystone`].
    pub keystone: [f64; 2],
    /// Degrees.
    pub turn_deg: f64,
    /// Down per px to the right, px.
    pub shear: f64,
}

impl Alone {
    fn map(&self, [cx, cy]: [f64; 2]) -> Matrix3<f64> {
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let [px, py] = [-self.keystone[0] / cx.max(1.0), -self.keystone[1] / cy.max(1.0)];
        Matrix3::new(cos, -sin, 0.0, sin + self.shear, cos, 0.0, px, py, 1.0)
    }
}

impl Default for Rig {
    /// A small macro rig: 640 x 480 px, 9 slices, fixed lens, moderate imperfections.
    fn default() -> Self {
        Self::sized(640, 480, 9)
    }
}

impl Rig {
    /// A fixed-lens rig at magnification 1 with a 65 mm lens and a 24 mm wide sensor. The image shrinks by 6 %
    /// from the first slice to the last. The aperture is such that one step of the rail is 2 px of blur diameter (as a
    /// photographer would choose it), at most 40 px from one end of the stack to the other.
    ///
    /// Reference is the middle slice. Imperfections: drift, rotation, keystone, falling exposure,
    /// vignetting, noise 1 of 255.
    pub fn sized(width: usize, height: usize, slices: usize) -> Self {
        let (focal_mm, magnification) = (65.0, 1.0);
        let d2 = focal_mm * (1.0 + magnification);
        let travel = 0.06 * d2;
        let slices = slices.max(1);
        let steps = slices.saturating_sub(1).max(1) as f64;
        let pixel_pitch_mm = 24.0 / width as f64;
        let blur_px = (2.0 * steps).min(40.0);
        let aperture_mm = blur_px * pixel_pitch_mm * d2 / travel;
        let scale = width as f64 / 1000.0;
        Self {
            mode: CaptureMode::FixedLens,
            focal_mm,
            pupil_ratio: 1.0,
            f_number: focal_mm / aperture_mm,
            pixel_pitch_mm,
            width,
            height,
            magnification,
            rail_mm: (0..slices).map(|i| travel * (0.5 - i as f64 / steps)).collect(),
            reference: slices / 2,
            drift_px: [6.0 * scale, -4.0 * scale],
            displaced_px: Vec::new(),
            alone: None,
            rotation_deg: 0.15,
            keystone: [4e-4, -3e-4],
            vignetting: 0.15,
            exposure_falls: true,
            softness_px: 0.0,
            noise: 1.0,
            depth: Depth::Eight,
            channels: 3,
            seed: 1,
        }
    }

    /// The same rig without drift, displacement, rotation, keystone, vignetting and noise. Exposure and softness stay.
    #[must_use]
    pub fn ideal(self) -> Self {
        Self {
            drift_px: [0.0; 2],
            displaced_px: Vec::new(),
            alone: None,
            rotation_deg: 0.0,
            keystone: [0.0; 2],
            vignetting: 0.0,
            noise: 0.0,
            ..self
        }
    }

    /// A focus range of the same length, but camera and lens move together towards the object.
    #[must_use]
    pub fn moving_lens(mut self) -> Self {
        let ends = [0.0, 1.0].map(|fraction| self.object_distance(fraction));
        let count = self.rail_mm.len();
        let steps = count.saturating_sub(1).max(1) as f64;
        self.rail_mm = (0..count).map(|i| (ends[1] - ends[0]) * (i as f64 / steps - 0.5)).collect();
        self.mode = CaptureMode::MovingLens;
        self
    }

    /// Number of slices.
    pub fn slices(&self) -> usize {
        self.rail_mm.len()
    }

    /// Diameter of the aperture, phi_a = f / N.
    pub fn aperture_mm(&self) -> f64 {
        self.focal_mm / self.f_number
    }

    /// The point about which slices scale: the middle of the image.
    pub fn centre(&self) -> [f64; 2] {
        [(self.width as f64 - 1.0) / 2.0, (self.height as f64 - 1.0) / 2.0]
    }

    /// The lens, focused as in the reference slice.
    pub fn lens(&self) -> Lens {
        Lens { focal_mm: self.focal_mm, magnification: self.magnification, pupil_ratio: self.pupil_ratio }
    }

    /// How far the sensor is from the lens in slice `i`, beyond its distance in the reference slice.
    fn sensor_offset(&self, rail: f64) -> f64 {
        match self.mode {
            CaptureMode::FixedLens | CaptureMode::LensAlone => rail,
            CaptureMode::MovingLens => 0.0,
        }
    }

    /// Principal distance of slice `i`.
    ///
    /// # Panics
    /// When there is no slice `i`.
    pub fn principal_distance(&self, i: usize) -> f64 {
        self.lens().with_sensor_moved(self.sensor_offset(self.advance(i))).principal_distance()
    }

    /// Distance from the centre of projection, the entrance pupil, of the object at depth `fraction`, with the rail at
    /// the reference.
    pub fn object_distance(&self, fraction: f64) -> f64 {
        let last = self.rail_mm.len() - 1;
        let rail = self.rail_mm[0] + fraction * (self.rail_mm[last] - self.rail_mm[0]) - self.rail_mm[self.reference];
        let lens = self.lens();
        let focused = lens.with_sensor_moved(self.sensor_offset(rail));
        let moved = if self.mode == CaptureMode::FixedLens { 0.0 } else { rail };
        focused.object_distance() + moved - lens.entrance_pupil_position()
    }

    /// Depth fraction of what is `distance` mm from the centre of projection with the rail at the reference: the
    /// inverse of [`Rig::object_distance`]. It is below 0 or above 1 for what no slice has in focus, and 0 in a rig of
    /// one slice.
    pub fn depth_of(&self, distance: f64) -> f64 {
        let (first, last) = (self.rail_mm[0], self.rail_mm[self.rail_mm.len() - 1]);
        let lens = self.lens();
        let distance = distance + lens.entrance_pupil_position();
        let rail = match self.mode {
            CaptureMode::FixedLens => lens.conjugate(distance) - lens.image_distance(),
            CaptureMode::MovingLens => distance - lens.object_distance(),
            CaptureMode::LensAlone => {
                // the lens between object and sensor, which keep their distance: d2^2 - d2 (d1 + d2) + f (d1 + d2) = 0
                let whole = distance + lens.image_distance();
                let root = (whole * (whole - 4.0 * lens.focal_mm)).max(0.0).sqrt();
                (whole + if lens.magnification > 1.0 { root } else { -root }) / 2.0 - lens.image_distance()
            }
        };
        if first == last { 0.0 } else { (rail + self.rail_mm[self.reference] - first) / (last - first) }
    }

    /// Depth fraction of what is in focus in slice `i`.
    pub fn focus_fraction(&self, i: usize) -> f64 {
        let (first, last) = (self.rail_mm[0], self.rail_mm[self.rail_mm.len() - 1]);
        if first == last { 0.0 } else { (self.rail_mm[i] - first) / (last - first) }
    }

    /// Index of the slice in which depth `fraction` is in focus, with a fraction between two slices.
    pub fn slice_in_focus(&self, fraction: f64) -> f64 {
        let last = self.rail_mm.len() - 1;
        if last == 0 {
            return 0.0;
        }
        let below = (0..last).rev().find(|&i| self.focus_fraction(i) <= fraction).unwrap_or(0);
        let (from, to) = (self.focus_fraction(below), self.focus_fraction(below + 1));
        below as f64 + (fraction - from) / (to - from)
    }

    /// Radius in px of the circle of confusion of depth `fraction` in slice `i`.
    pub fn blur_radius_px(&self, i: usize, fraction: f64) -> f64 {
        self.blur_radius_of(i, self.object_distance(fraction))
    }

    /// The same for an object `distance` mm from the centre of projection with the rail at the reference.
    pub(super) fn blur_radius_of(&self, i: usize, distance: f64) -> f64 {
        let lens = self.lens();
        let object = self.distance_in(i, distance) + lens.entrance_pupil_position();
        let image = lens.image_distance() + self.sensor_offset(self.advance(i));
        lens.blur(image, object, self.f_number) / 2.0 / self.pixel_pitch_mm
    }

    /// Distance from the centre of projection in slice `i` of what is `distance` mm away with the rail at the
    /// reference.
    pub(super) fn distance_in(&self, i: usize, distance: f64) -> f64 {
        match self.mode {
            CaptureMode::FixedLens => distance,
            CaptureMode::MovingLens | CaptureMode::LensAlone => distance - self.advance(i),
        }
    }

    /// Rail position of slice `i` relative to the reference slice.
    fn advance(&self, i: usize) -> f64 {
        self.rail_mm[i] - self.rail_mm[self.reference]
    }

    /// Scale of the image at depth `fraction` in slice `i` relative to that in the reference slice. The same for
    /// every depth when the lens is fixed; different by parallax when it moves.
    pub fn scale(&self, i: usize, fraction: f64) -> f64 {
        let distance = self.object_distance(fraction);
        let sensor = self.principal_distance(i) / self.principal_distance(self.reference);
        sensor * distance / self.distance_in(i, distance)
    }

    /// The truth for slice `i`: slice px -> reference px. Exact for every depth with a fixed lens; with a
    /// moving lens exact for what is in focus in the reference slice, while other depths move by parallax
    /// ([`Rig::homography_at`]).
    pub fn homography(&self, i: usize) -> Homography {
        self.homography_at(i, self.focus_fraction(self.reference))
    }

    /// The truth for slice `i` and depth `fraction`: slice px -> reference px; NaN if it cannot be inverted.
    pub fn homography_at(&self, i: usize, fraction: f64) -> Homography {
        if i == self.reference {
            return Homography::IDENTITY;
        }
        let about = self.centre();
        let to_slice = self.disturbance(i) * scaling(self.scale(i, fraction), about);
        let invertible = to_slice.try_inverse().and_then(|back| Homography::from_matrix(&back));
        invertible.unwrap_or(Homography([f64::NAN; 9]))
    }

    /// Drift, displacement, rotation and keystone of slice `i`: ideal slice px -> slice px. The identity for the
    /// reference slice.
    pub(super) fn disturbance(&self, i: usize) -> Matrix3<f64> {
        if i == self.reference {
            return Matrix3::identity();
        }
        let along = self.focus_fraction(i) - self.focus_fraction(self.reference);
        let jitter = |axis: u64| between(key(&[self.seed, 0xd1f7, i as u64, axis]), -0.1, 0.1);
        let displaced = |axis: usize| {
            let at = |slice: usize| self.displaced_px.get(slice).map_or(0.0, |by| by[axis]);
            at(i) - at(self.reference)
        };
        let shift = [0, 1].map(|axis| self.drift_px[axis] * (along + jitter(axis as u64)) + displaced(axis));
        let (sin, cos) = (self.rotation_deg * along).to_radians().sin_cos();
        let [cx, cy] = self.centre();
        let perspective = [-self.keystone[0] * along / cx.max(1.0), -self.keystone[1] * along / cy.max(1.0)];
        let inner = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, perspective[0], perspective[1], 1.0);
        let alone =
            self.alone.filter(|alone| alone.slice == i).map_or(Matrix3::identity(), |alone| alone.map([cx, cy]));
        shifting([cx + shift[0], cy + shift[1]]) * alone * inner * shifting([-cx, -cy])
    }

    /// Light per pixel in slice `i`, 1 in the reference: it falls with the square of the distance from the exit pupil
    /// to the sensor, and so of the principal distance.
    pub fn exposure(&self, i: usize) -> f64 {
        if !self.exposure_falls {
            return 1.0;
        }
        (self.principal_distance(self.reference) / self.principal_distance(i)).powi(2)
    }

    /// The truth for slice `i`: multiply its values by this to match the reference.
    pub fn gain(&self, i: usize) -> f64 {
        1.0 / self.exposure(i)
    }
}

fn shifting(by: [f64; 2]) -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, by[0], 0.0, 1.0, by[1], 0.0, 0.0, 1.0)
}

fn scaling(scale: f64, about: [f64; 2]) -> Matrix3<f64> {
    let shift = [about[0] * (1.0 - scale), about[1] * (1.0 - scale)];
    Matrix3::new(scale, 0.0, shift[0], 0.0, scale, shift[1], 0.0, 0.0, 1.0)
}

#[cfg(test)]
mod tests;
