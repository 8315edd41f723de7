//! What a capture plan is made for, and the rules for it.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::{
    optics::{refused, require},
    types::{
        Error,
        profile::{CaptureMode, MAX_SLICES},
    },
};

/// What a plan is made for: the query parameters of `GET /v1/optics/plan`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PlanInput {
    /// Focal length of the lens at its setting, mm.
    #[param(example = 65.0)]
    pub focal_mm: f64,
    /// f-number that is set on the lens.
    #[param(example = 5.6)]
    pub f_number: f64,
    /// Magnification of the middle of the object. Give this or `object_distance_mm`.
    #[serde(default)]
    #[param(example = 1.0)]
    pub magnification: Option<f64>,
    /// Distance from the lens to the middle of the object, mm.
    #[serde(default)]
    pub object_distance_mm: Option<f64>,
    /// Size of one pixel on the sensor, micrometres.
    #[param(example = 4.14)]
    pub pixel_pitch_um: f64,
    /// Depth of the object along the optical axis, mm.
    #[param(example = 5.0)]
    pub object_depth_mm: f64,
    /// What moves between slices.
    #[param(example = "fixed_lens", inline)]
    pub mode: CaptureMode,
    /// Width of the image, px. With `image_height` for the field of view and the number of dots of a target.
    #[serde(default)]
    pub image_width: Option<u32>,
    /// Height of the image, px.
    #[serde(default)]
    pub image_height: Option<u32>,
    /// Diameter of the exit pupil over that of the entrance pupil; default 1.
    #[serde(default = "one")]
    #[param(required = false)]
    pub pupil_ratio: f64,
    /// Share of the depth of field, by geometry and diffraction together, that neighbouring slices have in common;
    /// default 0.5.
    #[serde(default = "half")]
    #[param(required = false)]
    pub overlap: f64,
    /// Wavelength of the light, nm; default 550.
    #[serde(default = "green")]
    #[param(required = false)]
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

impl PlanInput {
    /// Checks every number but magnification and object distance.
    pub(super) fn check(&self) -> Result<(), Error> {
        require("focal_mm", self.focal_mm, 0.1, 10_000.0)?;
        require("f_number", self.f_number, 0.5, 1000.0)?;
        require("pixel_pitch_um", self.pixel_pitch_um, 0.01, 1000.0)?;
        require("object_depth_mm", self.object_depth_mm, 1e-4, 10_000.0)?;
        require("pupil_ratio", self.pupil_ratio, 0.05, 20.0)?;
        require("overlap", self.overlap, 0.0, 0.95)?;
        require("wavelength_nm", self.wavelength_nm, 200.0, 2000.0)?;
        if let Some(coc) = self.coc_um {
            require("coc_um", coc, 0.01, 1000.0)?;
        }
        if let Some(resolution) = self.rail_resolution_um {
            require("rail_resolution_um", resolution, 0.0, 10_000.0)?;
        }
        for (name, size) in [("image_width", self.image_width), ("image_height", self.image_height)] {
            if let Some(size) = size {
                require(name, f64::from(size), 16.0, 65_535.0)?;
            }
        }
        if let Some(count) = self.slice_count {
            require("slice_count", f64::from(count), 2.0, MAX_SLICES as f64)?;
        }
        Ok(())
    }

    /// The magnification, given itself or by the object distance.
    pub(super) fn magnification(&self) -> Result<f64, Error> {
        match (self.magnification, self.object_distance_mm) {
            (Some(magnification), None) => {
                require("magnification", magnification, 1e-4, 1000.0)?;
                Ok(magnification)
            }
            (None, Some(distance)) => {
                require("object_distance_mm", distance, 0.1, 1e6)?;
                if distance <= self.focal_mm {
                    let detail = format!(
                        "object_distance_mm is {distance}, within the focal length of {} mm, where nothing is in focus",
                        self.focal_mm
                    );
                    return Err(refused("object_distance_mm", detail));
                }
                Ok(self.focal_mm / (distance - self.focal_mm))
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
}
