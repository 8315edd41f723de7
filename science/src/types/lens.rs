//! The lens model: a thick lens with two pupils, focused on a plane. Every optical formula of the project is here.
//!
//! In: focal length `f`, magnification `M` of the plane in focus, pupil ratio `P` (diameter of the exit pupil over that
//! of the entrance pupil), and what moves. Out: distances, sizes and blur. All lengths are mm, measured away from the
//! lens. `docs/METHOD.md` has a drawing.
//!
//! The chief ray of a point goes through the centres of both pupils. Blur discs are centred on it, so the picture is
//! that of a pinhole camera whose centre is the entrance pupil. The slope of the chief ray behind the lens is `1 / P`
//! of that before it, so the principal distance is `E / P` and not `E`.
//!
//! | quantity | formula | source |
//! |---|---|---|
//! | entrance pupil to the plane in focus | `D = f / M + f / P` | Newton's equation (Smith, *Modern Optical Engineering*): the plane is `f / M` before the front focal point, and the pupil `f / P` behind it |
//! | exit pupil to the sensor | `E = f M + f P` | the same behind the lens |
//! | principal distance | `c = E / P = M D = f (1 + M / P)` | Lagrange invariant (Smith); perspective centre in the entrance pupil (Luhmann et al., *Close-Range Photogrammetry and 3D Imaging*) |
//! | effective f-number | `N (1 + M / P)` | Kingslake, *Optics in Photography*; Ray, *Applied Photographic Optics* |
//! | size when the sensor moves by `z` | `1 - z / E` | similar triangles behind the lens |
//! | size when camera and lens move by `z` | `1 / (1 - z / D)` | similar triangles before the lens |
//! | size when the lens alone moves by `z` | `(1 + z / E) / (1 - z / D)` | both |
//!
//! `z` counts towards the object, and sizes are those of a target that is in focus at `z = 0`. Distances from the
//! principal planes (`f (1 + 1 / M)` and `f (1 + M)`) tell what is in focus; they are no principal distance unless `P`
//! is 1.

use super::capture_mode::CaptureMode;

/// A lens that is focused on a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Focal length f between the principal planes.
    pub focal_mm: f64,
    /// Magnification M of the plane in focus: image size over object size.
    pub magnification: f64,
    /// Pupil ratio P: diameter of the exit pupil over that of the entrance pupil.
    pub pupil_ratio: f64,
}

/// The pupil ratios of macro lenses: telephoto designs are below 1, retrofocus designs above.
pub const PLAUSIBLE_PUPIL_RATIOS: [f64; 2] = [0.4, 2.5];

impl Lens {
    /// The lens whose exit pupil is `exit_pupil_distance` from the sensor: `f = E / (M + P)`.
    pub fn of_exit_pupil(exit_pupil_distance: f64, magnification: f64, pupil_ratio: f64) -> Self {
        Self { focal_mm: exit_pupil_distance / (magnification + pupil_ratio), magnification, pupil_ratio }
    }

    /// The lens whose entrance pupil is `entrance_pupil_distance` from the plane in focus: `f = D / (1 / M + 1 / P)`.
    pub fn of_entrance_pupil(entrance_pupil_distance: f64, magnification: f64, pupil_ratio: f64) -> Self {
        let focal_mm = entrance_pupil_distance / (1.0 / magnification + 1.0 / pupil_ratio);
        Self { focal_mm, magnification, pupil_ratio }
    }

    /// The lens by what the size of its image grows per mm when it moves alone: `1 / E + 1 / D = g`, so
    /// `f = (1 + M P) / (g (M + P))`.
    pub fn of_growth(growth: f64, magnification: f64, pupil_ratio: f64) -> Self {
        let focal_mm = (1.0 + magnification * pupil_ratio) / (growth * (magnification + pupil_ratio));
        Self { focal_mm, magnification, pupil_ratio }
    }

    /// The same lens with the sensor moved by `mm` away from it: `M' = M + mm / f`.
    #[must_use]
    pub fn with_sensor_moved(self, mm: f64) -> Self {
        Self { magnification: self.magnification + mm / self.focal_mm, ..self }
    }

    /// Front principal plane to the plane in focus: `f (1 + 1 / M)`.
    pub fn object_distance(&self) -> f64 {
        self.focal_mm * (1.0 + 1.0 / self.magnification)
    }

    /// Rear principal plane to the sensor: `f (1 + M)`.
    pub fn image_distance(&self) -> f64 {
        self.focal_mm * (1.0 + self.magnification)
    }

    /// Entrance pupil, the centre of projection, to the plane in focus: `D = f (1 / M + 1 / P)`.
    pub fn entrance_pupil_distance(&self) -> f64 {
        self.focal_mm * (1.0 / self.magnification + 1.0 / self.pupil_ratio)
    }

    /// Exit pupil to the sensor: `E = f (M + P)`.
    pub fn exit_pupil_distance(&self) -> f64 {
        self.focal_mm * (self.magnification + self.pupil_ratio)
    }

    /// Principal distance of the pinhole camera: `c = E / P`.
    pub fn principal_distance(&self) -> f64 {
        self.exit_pupil_distance() / self.pupil_ratio
    }

    /// Entrance pupil before the front principal plane: `f - f / P`; negative behind it.
    pub fn entrance_pupil_position(&self) -> f64 {
        self.focal_mm * (1.0 - 1.0 / self.pupil_ratio)
    }

    /// Effective f-number of a lens with the f-number `f_number`.
    pub fn effective_f_number(&self, f_number: f64) -> f64 {
        f_number * (1.0 + self.magnification / self.pupil_ratio)
    }

    /// Size of the image of a target that is in focus at rail position 0, with the rail at `z`, relative to its size at
    /// 0. `z` counts towards the object.
    pub fn size(&self, mode: CaptureMode, z: f64) -> f64 {
        let (sensor, camera) = (z / self.exit_pupil_distance(), z / self.entrance_pupil_distance());
        match mode {
            CaptureMode::FixedLens => 1.0 - sensor,
            CaptureMode::MovingLens => 1.0 / (1.0 - camera),
            CaptureMode::LensAlone => (1.0 + sensor) / (1.0 - camera),
        }
    }

    /// Light per pixel with the rail at `z`, relative to that at 0: it falls with the square of the distance from the
    /// exit pupil to the sensor.
    pub fn light(&self, mode: CaptureMode, z: f64) -> f64 {
        let nearer = match mode {
            CaptureMode::FixedLens => z,
            CaptureMode::MovingLens => 0.0,
            CaptureMode::LensAlone => -z,
        };
        (1.0 - nearer / self.exit_pupil_distance()).powi(-2)
    }

    /// How much nearer to the camera the plane in focus is with the rail at `z` than at 0. With the lens alone it is
    /// the distance to the sensor that counts.
    pub fn focus_shift(&self, mode: CaptureMode, z: f64) -> f64 {
        match mode {
            CaptureMode::FixedLens => self.object_distance() - self.with_sensor_moved(-z).object_distance(),
            CaptureMode::MovingLens => -z,
            CaptureMode::LensAlone => self.object_distance() - self.with_sensor_moved(z).object_distance() - z,
        }
    }

    /// The other conjugate distance from a principal plane: `1 / f = 1 / d + 1 / d'`.
    pub fn conjugate(&self, distance: f64) -> f64 {
        self.focal_mm * distance / (distance - self.focal_mm)
    }

    /// Diameter of the blur disc of a point `distance` before the front principal plane, on a sensor `image_distance`
    /// behind the rear one: the cone from the exit pupil, `|d2 - d2'| / N'`, in a form without the pole at `f`.
    pub fn blur(&self, image_distance: f64, distance: f64, f_number: f64) -> f64 {
        let beyond = distance - self.focal_mm;
        let from_pupil = beyond + self.focal_mm / self.pupil_ratio;
        (image_distance * beyond - self.focal_mm * distance).abs() / (f_number * from_pupil)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Height on the sensor of the ray from `height` on a plane `before` the front principal plane through the height
    /// `aim` of the entrance pupil, with the sensor `behind` the rear principal plane; no formula of [`Lens`] is used.
    fn traced(lens: &Lens, height: f64, aim: f64, before: f64, behind: f64) -> f64 {
        let f = lens.focal_mm;
        let slope = (aim - height) / (before - (f - f / lens.pupil_ratio));
        let at_lens = height + slope * before;
        -(at_lens + (slope - at_lens / f) * behind)
    }

    fn lenses() -> impl Iterator<Item = Lens> {
        let both =
            |pupil_ratio| [0.5, 1.0, 2.5].map(|magnification| Lens { focal_mm: 65.0, magnification, pupil_ratio });
        [0.6, 1.0, 1.8].into_iter().flat_map(both)
    }

    #[test]
    fn the_principal_distance_is_that_of_traced_chief_rays() {
        for lens in lenses() {
            let (before, behind) = (lens.object_distance(), lens.image_distance());
            let pupil = 65.0 - 65.0 / lens.pupil_ratio;
            // the image of a ray of slope 1 through the centre of the entrance pupil
            let image = traced(&lens, before - pupil, 0.0, before, behind);
            assert!((lens.principal_distance() - image).abs() < 1e-9, "{lens:?}: {image}");
            assert!((lens.entrance_pupil_distance() - (before - pupil)).abs() < 1e-9);
            assert!((lens.magnification * lens.entrance_pupil_distance() - image).abs() < 1e-9);
        }
    }

    #[test]
    fn sizes_blur_and_light_are_those_of_traced_rays_whatever_moves() {
        for lens in lenses() {
            let (before, behind) = (lens.object_distance(), lens.image_distance());
            let at_reference = traced(&lens, 1.0, 0.0, before, behind);
            for z in [-2.0, 0.7, 1.5] {
                for (mode, before, behind) in [
                    (CaptureMode::FixedLens, before, behind - z),
                    (CaptureMode::MovingLens, before - z, behind),
                    (CaptureMode::LensAlone, before - z, behind + z),
                ] {
                    let size = traced(&lens, 1.0, 0.0, before, behind) / at_reference;
                    assert!((lens.size(mode, z) - size).abs() < 1e-12, "{lens:?} {mode:?}");
                    let blur = 2.0 * traced(&lens, 0.0, 65.0 / 8.0 / 2.0, before, behind).abs();
                    assert!((lens.blur(behind, before, 8.0) - blur).abs() < 1e-9, "{lens:?} {mode:?}");
                    // the plane in focus, from where the object was at the reference
                    let focused = 65.0 * behind / (behind - 65.0);
                    assert!((lens.focus_shift(mode, z) - (before - focused)).abs() < 1e-9, "{lens:?} {mode:?}");
                }
            }
            assert_eq!(lens.light(CaptureMode::MovingLens, 1.0), 1.0);
            let light = (lens.exit_pupil_distance() / (lens.exit_pupil_distance() - 1.0)).powi(2);
            assert!((lens.light(CaptureMode::FixedLens, 1.0) - light).abs() < 1e-12);
        }
    }

    #[test]
    fn a_lens_follows_from_either_pupil_or_from_its_growth() {
        for lens in lenses() {
            let Lens { magnification: m, pupil_ratio: p, .. } = lens;
            let (e, d) = (lens.exit_pupil_distance(), lens.entrance_pupil_distance());
            for other in [
                Lens::of_exit_pupil(e, m, p),
                Lens::of_entrance_pupil(d, m, p),
                Lens::of_growth(1.0 / e + 1.0 / d, m, p),
            ] {
                assert!((other.focal_mm - 65.0).abs() < 1e-9, "{other:?}");
            }
        }
    }
}
