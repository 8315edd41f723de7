//! The path of the rail: from the slice that is focused on the nearest point of the object to the one focused on the
//! farthest.

use super::{capture_plan::PlannedSlice, input::PlanInput, lens::Lens};
use crate::{
    optics::refused,
    types::{Error, profile::CaptureMode},
};

/// Share of the free distance that an object may take up.
const FREE: f64 = 0.999;

/// What moves. Lengths in mm.
enum Movement {
    /// The sensor; its distance from the lens at rail position 0.
    Sensor { nearest: f64 },
    /// Camera and lens; their constant magnification.
    Camera { magnification: f64 },
}

/// The path of the rail.
pub(super) struct Path {
    movement: Movement,
    /// Length of the path, mm.
    pub(super) travel: f64,
    /// Largest step that keeps the overlap, mm.
    pub(super) largest_step: f64,
}

impl Path {
    /// The path along the depth of the object.
    ///
    /// # Errors
    /// `object_depth_mm`: with a fixed lens the nearest point would be within the focal length, with a moving lens the
    /// lens would reach the object.
    pub(super) fn of(input: &PlanInput, lens: &Lens, magnification: f64) -> Result<Self, Error> {
        let focused = lens.at(magnification);
        let middle = focused.object_distance();
        let depth = input.object_depth_mm;
        let share = 1.0 - input.overlap;
        match input.mode {
            CaptureMode::LensAlone => {
                let detail = "mode is lens_alone, for which no plan is made: near a magnification of 1 a lens that \
                              moves alone does not move the plane in focus; move the sensor, or camera and lens";
                Err(refused("mode", detail.to_owned()))
            }
            CaptureMode::MovingLens => {
                // in the last slice the nearest point is nearer by the whole depth
                let free = FREE * middle.min(focused.entrance_pupil_distance());
                if depth >= free {
                    let detail = format!(
                        "object_depth_mm is {depth}, but only {free:.1} mm are free between the lens (or its entrance \
                         pupil) and the plane in focus: on its way to the farthest point it would reach the nearest \
                         one; use a smaller magnification"
                    );
                    return Err(refused("object_depth_mm", detail));
                }
                let largest_step = share * lens.depth_of_field(magnification).total;
                Ok(Self { movement: Movement::Camera { magnification }, travel: depth, largest_step })
            }
            CaptureMode::FixedLens => {
                let [near, far] = [-0.5, 0.5].map(|end| middle + end * depth);
                // at the focal point the image distance is infinite
                if FREE * near <= lens.focal {
                    let detail = format!(
                        "object_depth_mm is {depth}: the nearest point of the object would be within the focal length of \
                         the lens ({} mm; the middle of the object is at {middle:.1} mm), where nothing is in focus; use \
                         a smaller magnification",
                        lens.focal
                    );
                    return Err(refused("object_depth_mm", detail));
                }
                let [nearest, farthest] = [near, far].map(|distance| focused.conjugate(distance));
                // the smallest magnification has the smallest depth of focus
                let least = lens.depth_of_focus(farthest / lens.focal - 1.0).total;
                let movement = Movement::Sensor { nearest };
                Ok(Self { movement, travel: nearest - farthest, largest_step: share * least })
            }
        }
    }

    /// Magnification of what is in focus at a rail position.
    pub(super) fn magnification(&self, rail: f64, lens: &Lens) -> f64 {
        match self.movement {
            Movement::Sensor { nearest } => (nearest - rail) / lens.focal - 1.0,
            Movement::Camera { magnification } => magnification,
        }
    }

    /// How far the sensor is out of focus, mm, for a point halfway between two slices that are `step` apart.
    pub(super) fn defocus(&self, step: f64) -> f64 {
        match self.movement {
            Movement::Sensor { .. } => step / 2.0,
            Movement::Camera { magnification } => step / 2.0 * magnification * magnification,
        }
    }

    /// Index of the slice whose focus is nearest to the middle of the object.
    pub(super) fn reference(&self, rail: &[f64], lens: &Lens, magnification: f64) -> usize {
        let middle = lens.at(magnification).object_distance();
        let off = |z: f64| match self.movement {
            Movement::Sensor { .. } => (lens.at(self.magnification(z, lens)).object_distance() - middle).abs(),
            Movement::Camera { .. } => (z - self.travel / 2.0).abs(),
        };
        (0..rail.len()).min_by(|&a, &b| off(rail[a]).total_cmp(&off(rail[b]))).unwrap_or(0)
    }

    /// Slice `i`, for a target that is in focus in the slice `reference`.
    pub(super) fn slice(&self, rail: &[f64], i: usize, reference: usize, lens: &Lens) -> PlannedSlice {
        let (z, origin) = (rail[i], rail[reference]);
        let [own, of_reference] = [z, origin].map(|rail| self.magnification(rail, lens));
        let [focused, reference_lens] = [own, of_reference].map(|magnification| lens.at(magnification));
        let target = reference_lens.object_distance();
        let image_distance = focused.image_distance();
        let advance = z - origin;
        let (depth_mm, scale, blur) = match self.movement {
            Movement::Sensor { .. } => {
                let depth = focused.object_distance() - lens.at(self.magnification(0.0, lens)).object_distance();
                let scale = 1.0 / reference_lens.size(CaptureMode::FixedLens, advance);
                (depth, scale, lens.blur(image_distance, target))
            }
            Movement::Camera { .. } => {
                let scale = 1.0 / focused.size(CaptureMode::MovingLens, advance);
                (z, scale, lens.blur(image_distance, target - advance))
            }
        };
        PlannedSlice {
            index: u32::try_from(i).unwrap_or(u32::MAX),
            rail_mm: z,
            depth_mm,
            magnification: own,
            scale,
            exposure_ratio: (lens.effective_f_number(of_reference) / lens.effective_f_number(own)).powi(2),
            target_blur_px: if i == reference { 0.0 } else { blur / 2.0 / lens.pixel },
        }
    }
}
