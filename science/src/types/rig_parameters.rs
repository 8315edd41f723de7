//! Profiles computed from rig parameters, without images.
//!
//! - Fixed lens: the sensor moves. The image scale is proportional to the distance from lens to sensor, so one scale
//!   per slice is exact for every depth.
//! - Moving lens: the camera approaches the object, and near parts grow faster than far parts. The scale is exact for a
//!   plane that is in focus in the reference slice; other depths keep their parallax.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Error, ErrorKind, Homography,
    error::ErrorLocation,
    profile::{CaptureMode, MAX_SLICES, ProfileInput, rail_violation, reference_beyond},
};

/// Source of the gains.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainLaw {
    /// From the optics. Fixed lens: light falls with the square of the distance from lens to sensor. Moving lens: that
    /// distance is constant, and so is the light.
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
    /// Size of one pixel of the uploaded slices, mm; larger than the camera's own when the slices were reduced.
    #[serde(default)]
    pub pixel_pitch_mm: Option<f64>,
    /// Rail position per slice, mm, strictly increasing or decreasing, counted towards the object: it increases when
    /// the sensor approaches the lens (`fixed_lens`), or when camera and lens approach the object (`moving_lens`).
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
        let gains = match (self.gains, self.capture_mode) {
            (GainLaw::Optics, CaptureMode::FixedLens) => {
                Some(along.iter().map(|&dz| (1.0 - dz / self.sensor_distance()).powi(2)).collect())
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
            principal_distance_mm: Some(self.sensor_distance()),
            principal_point_px: Some(point),
            magnification: Some(self.magnification),
            note: self.note.clone(),
            distortion: None,
            lateral_colour: None,
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

    /// Distance from lens to sensor in the reference slice, mm: `d2 = f (1 + M)`.
    pub fn sensor_distance(&self) -> f64 {
        self.focal_mm * (1.0 + self.magnification)
    }

    /// Distance from lens to the plane in focus in the reference slice, mm: `d1 = f (1 + 1/M)`.
    pub fn object_distance(&self) -> f64 {
        self.focal_mm * (1.0 + 1.0 / self.magnification)
    }

    /// Scale from a slice to the reference slice; `dz` is its rail position relative to the reference slice, mm. Fixed
    /// lens: `d2 / (d2 - dz)`; moving lens: `(d1 - dz) / d1`.
    pub fn scale(&self, dz: f64) -> f64 {
        match self.capture_mode {
            CaptureMode::FixedLens => self.sensor_distance() / (self.sensor_distance() - dz),
            CaptureMode::MovingLens => (self.object_distance() - dz) / self.object_distance(),
        }
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
        let ranges = [("focal_mm", self.focal_mm, 0.1, 10_000.0), ("magnification", self.magnification, 1e-4, 1e3)];
        for (name, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                let detail = format!("{name} is {value}; it must be {least} to {most}");
                return Err(at(&format!("/{name}"), detail, None));
            }
        }
        if self.sensor_distance() > 100_000.0 {
            let detail = format!(
                "focal_mm {} and magnification {} put the sensor {} mm from the lens; the limit is 100000 mm",
                self.focal_mm,
                self.magnification,
                self.sensor_distance()
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
        for (i, &dz) in along.iter().enumerate() {
            let (distance, least) = match self.capture_mode {
                CaptureMode::FixedLens => (self.sensor_distance() - dz, self.focal_mm),
                CaptureMode::MovingLens => (self.object_distance() - dz, 0.0),
            };
            if distance > least {
                continue;
            }
            let detail = match self.capture_mode {
                CaptureMode::FixedLens => format!(
                    "in slice {i} the sensor would be {distance:.2} mm from the lens, closer than the focal length of \
                     {least} mm, where nothing is in focus; check the sign of the rail (positive: towards the object, and so towards the \
                     lens) and the magnification"
                ),
                CaptureMode::MovingLens => format!(
                    "in slice {i} the lens would have moved {dz:.2} mm towards an object that is {:.2} mm away; check the \
                     positions of the rail (positive: towards the object) and the magnification",
                    self.object_distance()
                ),
            };
            return Err(at(self.rail_pointer(), detail, u32::try_from(i).ok()));
        }
        Ok(())
    }
}

fn at(pointer: &str, detail: impl Into<String>, slice: Option<u32>) -> Error {
    let detail = detail.into();
    let place = ErrorLocation { detail: detail.clone(), pointer: Some(pointer.to_owned()), file: None, slice };
    Error::new(ErrorKind::InvalidProfile, detail).at(place)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn macro_rig(capture_mode: CaptureMode) -> RigParameters {
        RigParameters {
            image_width: 1200,
            image_height: 800,
            reference_index: Some(1),
            slice_count: Some(3),
            focal_mm: 65.0,
            magnification: 1.0,
            pixel_pitch_mm: Some(0.004),
            rail_positions_mm: None,
            rail_step_mm: Some(0.5),
            capture_mode,
            principal_point_px: None,
            drift_px_per_mm: [0.0, 0.0],
            gains: GainLaw::Optics,
            note: None,
        }
    }

    fn refused(rig: &RigParameters) -> String {
        rig.profile().expect_err("the test gives something wrong").detail
    }

    #[test]
    fn a_sensor_closer_to_the_lens_sees_a_smaller_image_and_its_slice_is_scaled_up() {
        let profile = macro_rig(CaptureMode::FixedLens).profile().expect("sound");
        let scale = |i: usize| profile.homographies[i].0[0];
        assert!(scale(0) < 1.0 && scale(2) > 1.0, "{profile:?}");
        // d2 = 130 mm at magnification 1
        assert!((scale(2) - 130.0 / 129.5).abs() < 1e-12);
        assert_eq!(profile.principal_distance_mm, Some(130.0));
        assert_eq!(profile.principal_distance_px(), Some(32_500.0));
        assert_eq!(profile.rail_positions_mm, Some(vec![0.0, 0.5, 1.0]));
    }

    #[test]
    fn a_camera_closer_to_the_object_sees_a_larger_image_and_its_slice_is_scaled_down() {
        let profile = macro_rig(CaptureMode::MovingLens).profile().expect("sound");
        let scale = |i: usize| profile.homographies[i].0[0];
        assert!(scale(0) > 1.0 && scale(2) < 1.0, "{profile:?}");
        assert!((scale(2) - 129.5 / 130.0).abs() < 1e-12);
        assert_eq!(profile.gains, None);
    }

    #[test]
    fn a_sensor_farther_from_the_lens_receives_less_light_and_its_slice_is_brightened() {
        let rig = macro_rig(CaptureMode::FixedLens);
        let gains = rig.profile().expect("sound").gains.expect("gains by the optics");
        assert_eq!(gains[1], 1.0);
        assert!((gains[0] - (130.5_f64 / 130.0).powi(2)).abs() < 1e-12 && gains[2] < 1.0, "{gains:?}");
        assert_eq!(RigParameters { gains: GainLaw::None, ..rig }.profile().expect("sound").gains, None);
    }

    #[test]
    fn the_middle_slice_is_the_reference_unless_another_is_named() {
        let rig = RigParameters { reference_index: None, slice_count: Some(7), ..macro_rig(CaptureMode::FixedLens) };
        let profile = rig.profile().expect("sound");
        assert_eq!((profile.reference_index, profile.homographies[3]), (3, Homography::IDENTITY));
    }

    #[test]
    fn impossible_parameters_are_refused_with_a_remedy() {
        let rig = macro_rig(CaptureMode::FixedLens);
        let wrong = RigParameters { rail_step_mm: None, ..rig.clone() };
        assert!(refused(&wrong).starts_with("the rail is missing: give rail_positions_mm"));
        let wrong = RigParameters { rail_positions_mm: Some(vec![0.0, 1.0]), ..rig.clone() };
        assert!(refused(&wrong).contains("both given"));
        let wrong = RigParameters { rail_positions_mm: Some(vec![0.0, 1.0]), rail_step_mm: None, ..rig.clone() };
        assert_eq!(refused(&wrong), "2 rail positions for 3 slices: give one per slice");
        let wrong = RigParameters { slice_count: None, ..rig.clone() };
        assert!(refused(&wrong).starts_with("slice_count is missing"));
        let wrong = RigParameters { rail_step_mm: Some(40.0), slice_count: Some(5), ..rig.clone() };
        assert!(refused(&wrong).contains("where nothing is in focus; check the sign of the rail"));
        let wrong = RigParameters { rail_step_mm: Some(0.0), ..rig.clone() };
        assert!(refused(&wrong).starts_with("rail_step_mm is 0"));
        let wrong = RigParameters { magnification: f64::NAN, ..rig.clone() };
        assert!(refused(&wrong).starts_with("magnification is NaN; it must be 0.0001 to 1000"));
        let wrong = RigParameters { reference_index: Some(3), ..rig };
        assert_eq!(refused(&wrong), "reference_index is 3, but the stack has 3 slices: use an index from 0 to 2");
        let near = RigParameters { rail_step_mm: Some(140.0), ..macro_rig(CaptureMode::MovingLens) };
        assert!(refused(&near).contains("towards an object that is 130.00 mm away"));
    }

    #[test]
    fn every_error_points_at_a_parameter() {
        let rig = macro_rig(CaptureMode::FixedLens);
        let positions = |rail: &[f64]| RigParameters {
            reference_index: None,
            slice_count: None,
            rail_step_mm: None,
            rail_positions_mm: Some(rail.to_vec()),
            ..rig.clone()
        };
        let moving = macro_rig(CaptureMode::MovingLens);
        let far = RigParameters { focal_mm: 10_000.0, magnification: 10.0, ..moving.clone() };
        let grown = RigParameters { reference_index: Some(0), rail_step_mm: Some(-200.0), ..moving };
        let near = RigParameters { rail_step_mm: Some(40.0), slice_count: Some(5), ..rig.clone() };
        for (wrong, pointer, part) in [
            (positions(&[]), "/rail_positions_mm", "has 0 entries"),
            (positions(&[0.0]), "/rail_positions_mm", "has 1 entries"),
            (positions(&[0.0, 1.0, 0.5]), "/rail_positions_mm", "slice 2 at 0.5 mm"),
            (far, "/magnification", "110000 mm from the lens"),
            (grown, "/rail_step_mm", "scales the image"),
            (near, "/rail_step_mm", "check the sign of the rail"),
        ] {
            let error = wrong.profile().expect_err("impossible");
            let own = |location: &ErrorLocation| location.pointer.as_deref() == Some(pointer);
            assert!(error.detail.contains(part) && error.locations.iter().all(own), "{pointer}: {error:?}");
        }
    }

    prop_compose! {
        fn any_rig()(
            moving: bool, focal_mm in 20.0..200.0_f64, magnification in 0.2..5.0_f64, point in [300.0..900.0_f64, 200.0..600.0_f64],
            drift_px_per_mm in [-20.0..20.0_f64, -20.0..20.0_f64], step in 0.01..0.2_f64, falls: bool, reference in 0..9_u32,
        ) -> RigParameters {
            RigParameters {
                focal_mm,
                magnification,
                principal_point_px: Some(point),
                drift_px_per_mm,
                rail_step_mm: Some(if falls { -step } else { step }),
                reference_index: Some(reference),
                slice_count: Some(9),
                ..macro_rig(if moving { CaptureMode::MovingLens } else { CaptureMode::FixedLens })
            }
        }
    }

    proptest! {
        #[test]
        fn the_reference_is_the_identity_and_every_principal_point_maps_to_the_reference(rig in any_rig()) {
            let profile = rig.profile().expect("every rig of this kind is sound");
            let reference = rig.reference_index.expect("named") as usize;
            let rail = profile.rail_positions_mm.as_ref().expect("kept");
            let point = profile.principal_point_px.expect("kept");
            prop_assert!(profile.homographies[reference].is_identity());
            for (homography, z) in profile.homographies.iter().zip(rail) {
                let dz = z - rail[reference];
                let wandered = [0, 1].map(|axis| point[axis] + rig.drift_px_per_mm[axis] * dz);
                let home = homography.apply(wandered);
                prop_assert!((home[0] - point[0]).hypot(home[1] - point[1]) < 1e-6);
            }
        }

        #[test]
        fn the_scale_follows_the_sign_of_the_rail(rig in any_rig()) {
            let profile = rig.profile().expect("every rig of this kind is sound");
            let rail = profile.rail_positions_mm.as_ref().expect("kept");
            let reference = rig.reference_index.expect("named") as usize;
            for (homography, z) in profile.homographies.iter().zip(rail) {
                // towards the object the image shrinks with a fixed lens and grows with a moving one
                let dz = z - rail[reference];
                let larger = (dz > 0.0) == (rig.capture_mode == CaptureMode::MovingLens);
                prop_assert!(dz == 0.0 || (homography.0[0] < 1.0) == larger);
            }
        }

        #[test]
        fn with_a_fixed_lens_a_profile_rebased_on_another_slice_is_the_profile_of_that_reference(rig in any_rig(), other in 0..9_u32) {
            let rig = RigParameters { capture_mode: CaptureMode::FixedLens, drift_px_per_mm: [0.0; 2], ..rig };
            let profile = rig.profile().expect("sound");
            let reference = rig.reference_index.expect("named");
            let step = rig.rail_step_mm.expect("a step");
            // the same lens and sensor, described from the other slice
            let distance = rig.sensor_distance() - (f64::from(other) - f64::from(reference)) * step;
            let other_rig = RigParameters { magnification: distance / rig.focal_mm - 1.0, reference_index: Some(other), ..rig };
            let expected = other_rig.profile().expect("sound");
            let back = profile.homographies[other as usize].inverse().expect("invertible");
            for (a, b) in profile.homographies.iter().zip(&expected.homographies) {
                let a = a.then(&back).expect("finite");
                prop_assert!(a.corner_distance(b, 1200, 800) < 1e-6);
            }
        }
    }
}
