//! The capture plan: how many slices an object needs, and where the rail stops for each.
//!
//! Thin lens of focal length `f`, f-number `N` and pupil ratio `P`; magnification `M`, object distance
//! `d1 = f (1 + 1/M)`, image distance `d2 = f (1 + M)`; effective f-number `N_eff = N (1 + M/P)`; circle of confusion
//! `c`; wavelength `lambda`.
//!
//! | quantity | formula | source |
//! |---|---|---|
//! | geometric depth of focus | `2 c N_eff` | Li and Nguyen 2019, equations 1 to 3 |
//! | geometric depth of field | `2 c N_eff / M^2` | equations 4 to 6; the last form of 6 as printed swaps `f` and `d1 - f`, which is wrong by `M^2` |
//! | wave-optical depth of focus | `4 lambda N_eff^2` | `lambda / NA^2` with `NA = M / (2 N_eff)`, on the side of the sensor |
//! | wave-optical depth of field | `4 lambda N_eff^2 / M^2` | the same on the side of the object |
//! | diameter of the Airy disc | `2.44 lambda N_eff` | |
//!
//! The step is `1 - overlap` times the smaller of the geometric and the wave-optical depth: with a moving lens of the
//! depth of field, with a fixed lens of the depth of focus, because there the sensor moves. Of a stack, the slice with
//! the smallest depth decides.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{refused, require};
use crate::types::{
    Error, Warning,
    profile::{CaptureMode, MAX_SLICES},
};

/// What a plan is made for: the query parameters of `GET /v1/optics/plan`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanInput {
    /// Focal length of the lens at its setting, mm.
    pub focal_mm: f64,
    /// f-number that is set on the lens.
    pub f_number: f64,
    /// Magnification of the middle of the object. Give this or `object_distance_mm`.
    #[serde(default)]
    pub magnification: Option<f64>,
    /// Distance from the lens to the middle of the object, mm.
    #[serde(default)]
    pub object_distance_mm: Option<f64>,
    /// Size of one pixel on the sensor, micrometres.
    pub pixel_pitch_um: f64,
    /// Depth of the object along the optical axis, mm.
    pub object_depth_mm: f64,
    /// What moves between slices.
    pub mode: CaptureMode,
    /// Width of the image, px. With `image_height` for the field of view and the number of dots of a target.
    #[serde(default)]
    pub image_width: Option<u32>,
    /// Height of the image, px.
    #[serde(default)]
    pub image_height: Option<u32>,
    /// Diameter of the exit pupil over that of the entrance pupil.
    #[serde(default = "one")]
    pub pupil_ratio: f64,
    /// Share of the depth of field that neighbouring slices have in common.
    #[serde(default = "half")]
    pub overlap: f64,
    /// Wavelength of the light, nm.
    #[serde(default = "green")]
    pub wavelength_nm: f64,
    /// Diameter of the circle of confusion, micrometres. Default: 2.5 pixels.
    #[serde(default)]
    pub coc_um: Option<f64>,
    /// Smallest step of the rail, micrometres.
    #[serde(default)]
    pub rail_resolution_um: Option<f64>,
    /// Number of slices, if it is given rather than wanted.
    #[serde(default)]
    pub slice_count: Option<u32>,
}

fn one() -> f64 {
    1.0
}

fn half() -> f64 {
    0.5
}

fn green() -> f64 {
    550.0
}

/// Circle of confusion without `coc_um`, pixels.
const COC_PX: f64 = 2.5;
/// An Airy disc larger than so many circles of confusion decides the sharpness.
const AIRY_COC: f64 = 2.0;
/// Pixels per Airy disc beyond which the image has no more detail.
const AIRY_PX: f64 = 6.0;
/// Relative error of the first-order equations beyond which a warning is due.
const FIRST_ORDER: f64 = 0.01;

/// A capture plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturePlan {
    /// Magnification of the middle of the object.
    pub magnification: f64,
    /// Distance from the lens to the middle of the object, mm.
    pub object_distance_mm: f64,
    /// Distance from the lens to the sensor in the reference slice, mm: `principal_distance_mm` of the profile.
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
    fn of(geometric: f64, wave: f64) -> Self {
        Self { geometric, wave, total: geometric + wave }
    }

    fn least(&self) -> f64 {
        self.geometric.min(self.wave)
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

/// The lens at one focus.
struct Lens {
    focal: f64,
    f_number: f64,
    pupil_ratio: f64,
    wavelength: f64,
    coc: f64,
}

impl Lens {
    fn effective_f_number(&self, magnification: f64) -> f64 {
        self.f_number * (1.0 + magnification / self.pupil_ratio)
    }

    fn depth_of_focus(&self, magnification: f64) -> DepthRange {
        let n = self.effective_f_number(magnification);
        DepthRange::of(2.0 * self.coc * n, 4.0 * self.wavelength * n * n)
    }

    fn depth_of_field(&self, magnification: f64) -> DepthRange {
        let DepthRange { geometric, wave, .. } = self.depth_of_focus(magnification);
        let square = magnification * magnification;
        DepthRange::of(geometric / square, wave / square)
    }

    /// The other conjugate distance.
    fn conjugate(&self, distance: f64) -> f64 {
        self.focal * distance / (distance - self.focal)
    }
}

/// Plans a capture.
///
/// # Errors
/// [`crate::types::ErrorKind::InvalidParameter`] with the parameter: a number outside its range, both or neither of
/// magnification and object distance, an object that reaches the focal point of the lens, or more than 1000 slices.
pub fn plan(input: &PlanInput) -> Result<CapturePlan, Error> {
    check(input)?;
    let lens = Lens {
        focal: input.focal_mm,
        f_number: input.f_number,
        pupil_ratio: input.pupil_ratio,
        wavelength: input.wavelength_nm * 1e-6,
        coc: input.coc_um.unwrap_or(COC_PX * input.pixel_pitch_um) * 1e-3,
    };
    let magnification = magnification(input)?;
    let object_distance = lens.focal * (1.0 + 1.0 / magnification);
    let path = Path::of(input, &lens, magnification)?;
    let slice_count = slice_count(input, path.travel, path.largest_step)?;
    let steps = f64::from(slice_count - 1);
    let rail: Vec<f64> = (0..slice_count).map(|i| path.travel * f64::from(i) / steps).collect();
    let reference = path.reference(&rail, object_distance, &lens);
    let slices: Vec<PlannedSlice> = (0..rail.len()).map(|i| path.slice(&rail, i, reference, input, &lens)).collect();
    let principal_distance = path.sensor_distance(rail[reference]);
    let pitch = input.pixel_pitch_um * 1e-3;
    let effective = lens.effective_f_number(magnification);
    let size = input.image_width.zip(input.image_height);
    let mut plan = CapturePlan {
        magnification,
        object_distance_mm: object_distance,
        principal_distance_mm: principal_distance,
        principal_distance_px: principal_distance / pitch,
        effective_f_number: effective,
        numerical_aperture: magnification / (2.0 * effective),
        airy_um: 2.44e3 * lens.wavelength * effective,
        coc_um: 1e3 * lens.coc,
        depth_of_focus_mm: lens.depth_of_focus(magnification),
        depth_of_field_mm: lens.depth_of_field(magnification),
        field_of_view_mm: size.map(|(w, h)| [w, h].map(|side| f64::from(side) * pitch / magnification)),
        slice_count,
        reference_index: u32::try_from(reference).unwrap_or(u32::MAX),
        step_mm: path.travel / steps,
        largest_step_mm: path.largest_step,
        travel_mm: path.travel,
        rail_positions_mm: rail,
        common_field: match input.mode {
            CaptureMode::FixedLens => Some(slices.iter().map(|slice| slice.scale).fold(1.0, f64::min)),
            CaptureMode::MovingLens => None,
        },
        slices,
        warnings: Vec::new(),
    };
    plan.warnings = warnings(input, &plan);
    Ok(plan)
}

fn check(input: &PlanInput) -> Result<(), Error> {
    require("focal_mm", input.focal_mm, 0.1, 10_000.0)?;
    require("f_number", input.f_number, 0.5, 1000.0)?;
    require("pixel_pitch_um", input.pixel_pitch_um, 0.01, 1000.0)?;
    require("object_depth_mm", input.object_depth_mm, 1e-4, 10_000.0)?;
    require("pupil_ratio", input.pupil_ratio, 0.05, 20.0)?;
    require("overlap", input.overlap, 0.0, 0.95)?;
    require("wavelength_nm", input.wavelength_nm, 200.0, 2000.0)?;
    if let Some(coc) = input.coc_um {
        require("coc_um", coc, 0.01, 1000.0)?;
    }
    if let Some(resolution) = input.rail_resolution_um {
        require("rail_resolution_um", resolution, 0.0, 10_000.0)?;
    }
    for (name, size) in [("image_width", input.image_width), ("image_height", input.image_height)] {
        if let Some(size) = size {
            require(name, f64::from(size), 16.0, 65_535.0)?;
        }
    }
    if let Some(count) = input.slice_count {
        require("slice_count", f64::from(count), 2.0, MAX_SLICES as f64)?;
    }
    Ok(())
}

fn magnification(input: &PlanInput) -> Result<f64, Error> {
    match (input.magnification, input.object_distance_mm) {
        (Some(magnification), None) => {
            require("magnification", magnification, 1e-4, 1000.0)?;
            Ok(magnification)
        }
        (None, Some(distance)) => {
            require("object_distance_mm", distance, 0.1, 1e6)?;
            if distance <= input.focal_mm {
                let detail = format!(
                    "object_distance_mm is {distance}, within the focal length of {} mm, where nothing is in focus",
                    input.focal_mm
                );
                return Err(refused("object_distance_mm", detail));
            }
            Ok(input.focal_mm / (distance - input.focal_mm))
        }
        (Some(_), Some(_)) => {
            let detail = "magnification and object_distance_mm are both given; give one of them".to_owned();
            Err(refused("object_distance_mm", detail))
        }
        (None, None) => {
            let detail = "magnification is missing; give it, or object_distance_mm".to_owned();
            Err(refused("magnification", detail))
        }
    }
}

/// The movement of the rail.
enum Movement {
    /// The sensor moves; image distance at rail position 0, where the nearest point is in focus.
    Sensor { nearest: f64 },
    /// Camera and lens move; constant image distance.
    Camera { image_distance: f64 },
}

struct Path {
    movement: Movement,
    travel: f64,
    largest_step: f64,
}

impl Path {
    fn of(input: &PlanInput, lens: &Lens, magnification: f64) -> Result<Self, Error> {
        let middle = lens.focal * (1.0 + 1.0 / magnification);
        let share = 1.0 - input.overlap;
        match input.mode {
            CaptureMode::MovingLens => {
                if input.object_depth_mm / 2.0 >= middle {
                    return Err(too_deep(input, middle));
                }
                Ok(Self {
                    movement: Movement::Camera { image_distance: lens.focal * (1.0 + magnification) },
                    travel: input.object_depth_mm,
                    largest_step: share * lens.depth_of_field(magnification).least(),
                })
            }
            CaptureMode::FixedLens => {
                let [near, far] = [-0.5, 0.5].map(|end| middle + end * input.object_depth_mm);
                // at the focal point the image distance is infinite
                if near <= 1.001 * lens.focal {
                    return Err(too_deep(input, middle));
                }
                let [nearest, farthest] = [near, far].map(|distance| lens.conjugate(distance));
                // the smallest magnification has the smallest depth of focus
                let least = lens.depth_of_focus(farthest / lens.focal - 1.0).least();
                Ok(Self {
                    movement: Movement::Sensor { nearest },
                    travel: nearest - farthest,
                    largest_step: share * least,
                })
            }
        }
    }

    /// Distance from lens to sensor.
    fn sensor_distance(&self, rail: f64) -> f64 {
        match self.movement {
            Movement::Sensor { nearest } => nearest - rail,
            Movement::Camera { image_distance } => image_distance,
        }
    }

    /// Index of the slice whose focus is nearest to the middle of the object.
    fn reference(&self, rail: &[f64], middle: f64, lens: &Lens) -> usize {
        let off = |z: f64| match self.movement {
            Movement::Sensor { .. } => (lens.conjugate(self.sensor_distance(z)) - middle).abs(),
            Movement::Camera { .. } => (z - self.travel / 2.0).abs(),
        };
        (0..rail.len()).min_by(|&a, &b| off(rail[a]).total_cmp(&off(rail[b]))).unwrap_or(0)
    }

    fn slice(&self, rail: &[f64], i: usize, reference: usize, input: &PlanInput, lens: &Lens) -> PlannedSlice {
        let (z, origin) = (rail[i], rail[reference]);
        let (own, of_reference) = (self.sensor_distance(z), self.sensor_distance(origin));
        let aperture = lens.focal / lens.f_number;
        let target = lens.conjugate(of_reference);
        let (depth_mm, scale, blur) = match self.movement {
            Movement::Sensor { nearest } => {
                let depth = lens.conjugate(own) - lens.conjugate(nearest);
                (depth, of_reference / own, aperture * (own - of_reference).abs() / of_reference)
            }
            Movement::Camera { image_distance } => {
                // the target is nearer by the advance of the camera
                let distance = target - (z - origin);
                let blur = aperture * image_distance * (1.0 / target - 1.0 / distance).abs();
                (z, distance / target, blur)
            }
        };
        PlannedSlice {
            index: u32::try_from(i).unwrap_or(u32::MAX),
            rail_mm: z,
            depth_mm,
            magnification: own / lens.focal - 1.0,
            scale,
            exposure_ratio: (of_reference / own).powi(2),
            target_blur_px: blur / 2.0 / (input.pixel_pitch_um * 1e-3),
        }
    }
}

fn too_deep(input: &PlanInput, middle: f64) -> Error {
    let detail = format!(
        "object_depth_mm is {}: the nearest point of the object would be within the focal length of the lens ({} mm; the \
         middle of the object is at {middle:.1} mm), where nothing is in focus; use a smaller magnification",
        input.object_depth_mm, input.focal_mm
    );
    refused("object_depth_mm", detail)
}

fn slice_count(input: &PlanInput, travel: f64, largest_step: f64) -> Result<u32, Error> {
    if let Some(count) = input.slice_count {
        return Ok(count);
    }
    let count = (travel / largest_step).ceil() + 1.0;
    if count > MAX_SLICES as f64 {
        let detail = format!(
            "object_depth_mm is {}, which needs {count} slices of {:.4} mm; a stack has at most {MAX_SLICES}: stop down, \
             accept a smaller overlap, or use a smaller magnification",
            input.object_depth_mm, largest_step
        );
        return Err(refused("object_depth_mm", detail));
    }
    Ok((count as u32).max(2))
}

fn warnings(input: &PlanInput, plan: &CapturePlan) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut warn = |code: &str, detail: String| found.push(Warning::new(code, detail));
    if plan.airy_um > AIRY_COC * plan.coc_um {
        warn(
            "diffraction_limited",
            format!(
                "the Airy disc is {:.1} um wide, the circle of confusion {:.1} um: diffraction decides the sharpness; open \
                 the aperture and take more slices",
                plan.airy_um, plan.coc_um
            ),
        );
    }
    if plan.airy_um > AIRY_PX * input.pixel_pitch_um {
        let pixels = plan.airy_um / input.pixel_pitch_um;
        let detail = format!("the Airy disc covers {pixels:.1} pixels: smaller images would show the same detail");
        warn("oversampled", detail);
    }
    if input.rail_resolution_um.is_some_and(|resolution| 1e3 * plan.step_mm < resolution) {
        let detail = format!(
            "the step is {:.1} um, smaller than the rail can make: stop down or accept a smaller overlap",
            1e3 * plan.step_mm
        );
        warn("step_below_rail_resolution", detail);
    }
    if plan.step_mm > plan.largest_step_mm * (1.0 + 1e-9) {
        let detail = format!(
            "{} slices are {:.4} mm apart, more than the {:.4} mm that keep an overlap of {:.0} %: parts between them may be \
             out of focus",
            plan.slice_count,
            plan.step_mm,
            plan.largest_step_mm,
            100.0 * input.overlap
        );
        warn("too_few_slices", detail);
    }
    // near and far limits are d1 c' / (phi_a +- c') with c' = c / M
    let error = (1e-3 * plan.coc_um / plan.magnification * input.f_number / input.focal_mm).powi(2);
    if error > FIRST_ORDER {
        let detail =
            "the magnification is so small that depth of field is no longer symmetrical; the equations of macro \
                      photography do not hold"
                .to_owned();
        warn("first_order", detail);
    }
    found
}

#[cfg(test)]
mod tests;
