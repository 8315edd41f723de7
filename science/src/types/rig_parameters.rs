//! Profiles computed from rig parameters, without images.
//!
//! - Fixed lens: the sensor moves. The image scale is proportional to the distance from the exit pupil to the sensor,
//!   so one scale per slice is exact for every depth.
//! - Moving lens, and lens alone: the entrance pupil approaches the object, and near parts grow faster than far parts.
//!   The scale is exact for a plane that is in focus in the reference slice; other depths keep their parallax.
//!
//! The formulas are those of [`Lens`].

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Error, ErrorKind, Homography,
    error::ErrorLocation,
    lens::Lens,
    profile::{CaptureMode, MAX_SLICES, ProfileInput, rail_violation, reference_beyond},
    pupils::{PrincipalDistanceSource, Pupils},
};

/// Source of the gains.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainLaw {
    /// From the optics: light falls with the square of the distance from the exit pupil to the sensor. With a moving
    /// lens that distance is constant, and so is the light.
    #[default]
    Optics,
    /// All gains are 1: the slices are equally bright already.
    None,
}

/// Body of `POST /v1/profiles/{rig}/{lens}/rig-parameters`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RigParameters {
    /// Width of every slice in px.
    #[schema(minimum = 16, maximum = 65535)]
    pub image_width: u32,
    /// Height of every slice in px.
    #[schema(minimum = 16, maximum = 65535)]
    pub image_height: u32,
    /// 0-based index of the slice that all others are mapped to; default: slice count / 2, rounded down.
    #[serde(default)]
    pub reference_index: Option<u32>,
    /// Number of slices; optional with `rail_positions_mm`.
    #[serde(default)]
    #[schema(minimum = 2, maximum = 1000)]
    pub slice_count: Option<u32>,
    /// Focal length f of the lens at this setting, mm, 0.1 to 10,000.
    pub focal_mm: f64,
    /// Magnification M: image size over object size of what is in focus in the reference slice, 0.0001 to 1000.
    pub magnification: f64,
    /// Pupil ratio P of the lens: diameter of the exit pupil over that of the entrance pupil, 0.05 to 20. Default: 1 is
    /// assumed, with a warning; few macro lenses have that.
    #[serde(default)]
    pub pupil_ratio: Option<f64>,
    /// Size of one pixel of the uploaded slices, mm; larger than the camera's own when the slices were reduced.
    #[serde(default)]
    pub pixel_pitch_mm: Option<f64>,
    /// Rail position per slice, mm, strictly increasing or decreasing, counted towards the object: it increases when
    /// the sensor approaches the lens (`fixed_lens`), or when camera and lens (`moving_lens`) or the lens alone
    /// (`lens_alone`) approach the object.
    #[serde(default)]
    pub rail_positions_mm: Option<Vec<f64>>,
    /// Instead of the positions: the rail step from slice to slice, mm, with the same sign; -1000 to 1000, and not 0.
    #[serde(default)]
    pub rail_step_mm: Option<f64>,
    /// What moves between slices.
    pub capture_mode: CaptureMode,
    /// Where the optical axis meets the reference slice, `[x, y]` px; default: the centre of the image.
    #[serde(default)]
    pub principal_point_px: Option<[f64; 2]>,
    /// Shift of the principal point per mm of rail, `[x, y]` px, for a rail that is not parallel to the optical axis;
    /// -1000 to 1000 each.
    #[serde(default)]
    pub drift_px_per_mm: [f64; 2],
    /// Source of the gains.
    #[serde(default)]
    pub gains: GainLaw,
    /// Free text, at most 4,000 characters.
    #[serde(default)]
    pub note: Option<String>,
}

impl RigParameters {
    /// Computes the profile.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidProfile`]: values out of range, both or neither of positions and step, a sensor that would
    /// be closer to the lens than its focal length, or a camera that would reach the object. The location is that of
    /// the first violated rule; if only the computed profile is invalid, there is one per violated rule. Each points at
    /// a parameter.
    pub fn profile(&self) -> Result<ProfileInput, Error> {
        self.check_numbers()?;
        let rail = self.rail()?;
        let reference = self.reference_index.map_or(rail.len() / 2, |index| index as usize);
        let Some(&origin) = rail.get(reference) else {
            return Err(at("/reference_index", reference_beyond(reference, rail.len()), None));
        };
        let along: Vec<f64> = rail.iter().map(|z| z - origin).collect();
        self.check_reach(&along)?;

        let centre = [(f64::from(self.image_width) - 1.0) / 2.0, (f64::from(self.image_height) - 1.0) / 2.0];
        let point = self.principal_point_px.unwrap_or(centre);
        let homographies = along.iter().map(|&dz| self.homography(point, dz)).collect();
        let lens = self.lens();
        let gains = match (self.gains, self.capture_mode) {
            (GainLaw::Optics, CaptureMode::FixedLens | CaptureMode::LensAlone) => {
                Some(along.iter().map(|&dz| 1.0 / lens.light(self.capture_mode, dz)).collect())
            }
            (GainLaw::Optics, CaptureMode::MovingLens) | (GainLaw::None, _) => None,
        };
        let profile = ProfileInput {
            image_width: self.image_width,
            image_height: self.image_height,
            reference_index: u32::try_from(reference).unwrap_or(u32::MAX),
            homographies,
            rail_positions_mm: Some(rail),
            gains,
            pixel_pitch_mm: self.pixel_pitch_mm,
            capture_mode: Some(self.capture_mode),
            principal_distance_mm: Some(lens.principal_distance()),
            principal_distance_source: Some(match self.pupil_ratio {
                Some(_) => PrincipalDistanceSource::PupilRatio,
                None => PrincipalDistanceSource::FocalLength,
            }),
            pupils: Pupils {
                exit_pupil_distance_mm: Some(lens.exit_pupil_distance()),
                entrance_pupil_distance_mm: Some(lens.entrance_pupil_distance()),
                pupil_ratio: Some(lens.pupil_ratio),
                ..Pupils::default()
            },
            principal_point_px: Some(point),
            magnification: Some(self.magnification),
            note: self.note.clone(),
            distortion: None,
            lateral_colour: None,
            orientation: None,
        };
        match profile.check() {
            Ok(()) => Ok(profile),
            Err(error) => Err(self.in_own_terms(error)),
        }
    }

    /// An error of the computed profile, with pointers to the parameters from which it was computed.
    fn in_own_terms(&self, error: Error) -> Error {
        let own = |location: ErrorLocation| {
            let pointer = location.pointer.as_deref().unwrap_or_default();
            if !["/homographies", "/gains"].iter().any(|computed| pointer.starts_with(computed)) {
                return location;
            }
            let detail = format!("{}; check the rail, the focal length and the magnification", location.detail);
            ErrorLocation { detail, pointer: Some(self.rail_pointer().to_owned()), ..location }
        };
        let locations = error.locations.iter().cloned().map(own).collect();
        Error::of_locations(error.kind, locations).unwrap_or(error)
    }

    /// The member that gives the rail positions.
    fn rail_pointer(&self) -> &'static str {
        if self.rail_positions_mm.is_some() { "/rail_positions_mm" } else { "/rail_step_mm" }
    }

    /// The lens, focused as in the reference slice.
    pub fn lens(&self) -> Lens {
        let (focal_mm, magnification) = (self.focal_mm, self.magnification);
        Lens { focal_mm, magnification, pupil_ratio: self.pupil_ratio.unwrap_or(1.0) }
    }

    /// Scale from a slice to the reference slice; `dz` is its rail position relative to the reference slice, mm.
    pub fn scale(&self, dz: f64) -> f64 {
        1.0 / self.lens().size(self.capture_mode, dz)
    }

    /// The homography of a slice at `dz` mm from the reference slice: scales about the principal point, and moves it
    /// from its drifted position back to `point`.
    pub fn homography(&self, point: [f64; 2], dz: f64) -> Homography {
        let scale = self.scale(dz);
        let shift = |axis: usize| point[axis] - scale * (point[axis] + self.drift_px_per_mm[axis] * dz);
        Homography::similarity(scale, [shift(0), shift(1)])
    }

    /// Rail positions of all slices, mm.
    fn rail(&self) -> Result<Vec<f64>, Error> {
        match (&self.rail_positions_mm, self.rail_step_mm, self.slice_count) {
            (Some(_), Some(_), _) => {
                Err(at("/rail_step_mm", "rail_positions_mm and rail_step_mm are both given; give one of them", None))
            }
            (None, None, _) => Err(at(
                "/rail_positions_mm",
                "the rail is missing: give rail_positions_mm (one position per slice), or rail_step_mm with slice_count",
                None,
            )),
            (Some(positions), None, count) => {
                if let Some(count) = count.filter(|&count| count as usize != positions.len()) {
                    let detail = format!("{} rail positions for {count} slices: give one per slice", positions.len());
                    return Err(at("/rail_positions_mm", detail, None));
                }
                if !(2..=MAX_SLICES).contains(&positions.len()) {
                    let detail = format!(
                        "rail_positions_mm has {} entries; it must have one per slice, 2 to {MAX_SLICES}",
                        positions.len()
                    );
                    return Err(at("/rail_positions_mm", detail, None));
                }
                if let Some((slice, detail)) = rail_violation(positions) {
                    return Err(at("/rail_positions_mm", detail, u32::try_from(slice).ok()));
                }
                Ok(positions.clone())
            }
            (None, Some(_), None) => {
                Err(at("/slice_count", "slice_count is missing: rail_step_mm needs the number of slices", None))
            }
            (None, Some(step), Some(count)) => {
                if !(2..=MAX_SLICES).contains(&(count as usize)) {
                    let detail = format!("slice_count is {count}; a stack has 2 to {MAX_SLICES} slices");
                    return Err(at("/slice_count", detail, None));
                }
                if step == 0.0 || !(-1000.0..=1000.0).contains(&step) {
                    let detail = format!("rail_step_mm is {step}; it must be -1000 to 1000 and not 0");
                    return Err(at("/rail_step_mm", detail, None));
                }
                Ok((0..count).map(|i| f64::from(i) * step).collect())
            }
        }
    }

    fn check_numbers(&self) -> Result<(), Error> {
        let ranges = [
            ("focal_mm", self.focal_mm, 0.1, 10_000.0),
            ("magnification", self.magnification, 1e-4, 1e3),
            ("pupil_ratio", self.lens().pupil_ratio, 0.05, 20.0),
        ];
        for (name, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                let detail = format!("{name} is {value}; it must be {least} to {most}");
                return Err(at(&format!("/{name}"), detail, None));
            }
        }
        let distance = self.lens().principal_distance().max(self.lens().exit_pupil_distance());
        if distance > 100_000.0 {
            let detail = format!(
                "focal_mm {} and magnification {} put the sensor {distance} mm from the lens; the limit is 100000 mm",
                self.focal_mm, self.magnification,
            );
            return Err(at("/magnification", detail, None));
        }
        if !self.drift_px_per_mm.iter().all(|drift| (-1000.0..=1000.0).contains(drift)) {
            let detail = format!("drift_px_per_mm is {:?}; both numbers must be -1000 to 1000", self.drift_px_per_mm);
            return Err(at("/drift_px_per_mm", detail, None));
        }
        Ok(())
    }

    /// Refuses positions at which nothing can be in focus, which are mostly caused by a wrong sign.
    fn check_reach(&self, along: &[f64]) -> Result<(), Error> {
        let lens = self.lens();
        let object = lens.object_distance().min(lens.entrance_pupil_distance());
        for (i, &dz) in along.iter().enumerate() {
            let (towards_lens, towards_object) = match self.capture_mode {
                CaptureMode::FixedLens => (dz, 0.0),
                CaptureMode::MovingLens => (0.0, dz),
                CaptureMode::LensAlone => (-dz, dz),
            };
            let (sensor, focal) = (lens.image_distance() - towards_lens, self.focal_mm);
            let detail = if sensor <= focal {
                format!(
                    "in slice {i} the sensor would be {sensor:.2} mm from the lens, closer than the focal length of \
                     {focal} mm, where nothing is in focus; check the sign of the rail (positive: towards the object) and \
                     the magnification"
                )
            } else if towards_object >= object {
                format!(
                    "in slice {i} the lens would have moved {dz:.2} mm towards an object that is {object:.2} mm away; check \
                     the positions of the rail (positive: towards the object) and the magnification"
                )
            } else {
                continue;
            };
            return Err(at(self.rail_pointer(), detail, u32::try_from(i).ok()));
        }
        Ok(())
    }
}

fn at(pointer: &str, detail: impl Into<String>, slice: Option<u32>) -> Error {
    Error::new(ErrorKind::InvalidProfile, detail).in_field(pointer, slice)
}

#[cfg(test)]
mod tests;
