//! The values of a calibration profile: one homography and one gain per slice, and camera data.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Error, ErrorKind, Homography,
    distortion::Distortion,
    error::ErrorLocation,
    lateral_colour::LateralColour,
    pupils::{PrincipalDistanceSource, Pupils},
};

pub use super::capture_mode::CaptureMode;

/// The transform model of the homographies of a profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HomographyModel {
    /// One model for the whole stack: from the reference slice to a slice, scale and shift are linear in the rail
    /// position (three parameters; from stacks of objects rotation too).
    RailLinear,
    /// Scale and rotation follow the rail, and each slice has a shift of its own (two parameters per slice; from stacks
    /// of objects).
    RailShifts,
    /// Scale, rotation and shift per slice (four parameters).
    Similarity,
    /// Six parameters per slice.
    Affine,
    /// Eight parameters per slice (Li and Nguyen, DICTA 2019).
    Homography,
    /// Computed from focal length, magnification, pixel pitch and rail positions, without a measurement.
    RigParameters,
    /// Uploaded by a client; their origin is unknown.
    Given,
}

/// Body of `PUT /v1/profiles/{rig}/{lens}`: homographies measured elsewhere. Unknown members are ignored, so the
/// response of `GET` can be sent unchanged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProfileInput {
    /// Width of every slice in px.
    #[schema(minimum = 16, maximum = 65535)]
    pub image_width: u32,
    /// Height of every slice in px.
    #[schema(minimum = 16, maximum = 65535)]
    pub image_height: u32,
    /// 0-based index of the slice that all others are mapped to.
    pub reference_index: u32,
    /// One per slice, row-major, slice pixel -> reference-slice pixel, last element 1.
    #[schema(min_items = 2, max_items = 1000)]
    pub homographies: Vec<Homography>,
    /// Rail position per slice, mm, increasing towards the object; strictly increasing or decreasing.
    #[serde(default)]
    pub rail_positions_mm: Option<Vec<f64>>,
    /// Factor per slice that matches its brightness to the reference slice, 0.05 to 20.
    #[serde(default)]
    pub gains: Option<Vec<f64>>,
    /// Size of one pixel on the sensor, mm, 0.00001 to 1.
    #[serde(default)]
    pub pixel_pitch_mm: Option<f64>,
    /// What moves between slices.
    #[serde(default)]
    pub capture_mode: Option<CaptureMode>,
    /// Principal distance of the pinhole camera of the fused image, mm, 0.1 to 100,000; photogrammetry programs call it
    /// the focal length. It is `f (1 + M / P)` with focal length `f`, `magnification` M and `pupil_ratio` P: in macro
    /// photography neither the focal length engraved on the lens nor the distance from the lens to the sensor.
    #[serde(default)]
    pub principal_distance_mm: Option<f64>,
    /// What the principal distance is known from; null when it was not stated.
    #[serde(default)]
    pub principal_distance_source: Option<PrincipalDistanceSource>,
    /// What is known of the two pupils of the lens.
    #[serde(flatten)]
    pub pupils: Pupils,
    /// Intersection of the optical axis with the reference slice, `[x, y]` px.
    #[serde(default)]
    pub principal_point_px: Option<[f64; 2]>,
    /// Magnification (image size over object size) of the plane in focus in the reference slice, 0.0001 to 1000.
    #[serde(default)]
    pub magnification: Option<f64>,
    /// Free text, at most 4,000 characters.
    #[serde(default)]
    pub note: Option<String>,
    /// Radial lens distortion that stays with the sensor. The homographies are then between images without it.
    #[serde(default)]
    pub distortion: Option<Distortion>,
    /// EXIF orientation of the slices that the homographies were measured in, 1 to 8 (1 without a tag). Homographies
    /// belong to the sensor, so a stack of another orientation is refused. Null if it is unknown.
    #[schema(minimum = 1, maximum = 8)]
    #[serde(default)]
    pub orientation: Option<u8>,
    /// Lateral colour of the lens. Fusion moves red and blue to where green is, unless a
    /// stack has the option `lateral_colour=keep`.
    #[serde(default)]
    pub lateral_colour: Option<LateralColour>,
}

impl ProfileInput {
    /// [`ProfileInput::principal_distance_mm`] in px, which photogrammetry calls the focal length; `None` when the
    /// distance or the pixel pitch is unknown.
    pub fn principal_distance_px(&self) -> Option<f64> {
        Some(self.principal_distance_mm? / self.pixel_pitch_mm?)
    }

    /// The gain of slice `index`, 1 by default.
    pub fn gain(&self, index: usize) -> f64 {
        self.gains.as_ref().and_then(|gains| gains.get(index)).copied().unwrap_or(1.0)
    }
}

/// Range of rail positions, mm.
pub const RAIL_MM: RangeInclusive<f64> = -1e6..=1e6;

/// Maximum number of slices of a stack.
pub const MAX_SLICES: usize = 1000;

impl ProfileInput {
    /// Checks all rules and reports every violation.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidProfile`], with one location (a JSON pointer) per violated rule.
    pub fn check(&self) -> Result<(), Error> {
        let mut found = Violations::default();
        self.check_homographies(&mut found);
        self.check_slice_values(&mut found);
        self.check_camera(&mut found);
        if self.note.as_ref().is_some_and(|note| note.chars().count() > 4000) {
            found.add("/note", "the note is longer than 4,000 characters");
        }
        Error::of_locations(ErrorKind::InvalidProfile, found.0).map_or(Ok(()), Err)
    }

    /// The size of the image, and the homographies.
    fn check_homographies(&self, found: &mut Violations) {
        let count = self.homographies.len();
        for (name, size) in [("image_width", self.image_width), ("image_height", self.image_height)] {
            if !(16..=65_535).contains(&size) {
                found.add(format!("/{name}"), format!("{name} is {size}; it must be 16 to 65535 px"));
            }
        }
        if !(2..=MAX_SLICES).contains(&count) {
            let detail = format!("homographies has {count} entries; it must have one per slice, 2 to {MAX_SLICES}");
            found.add("/homographies", detail);
        }
        if count > 0 && self.reference_index as usize >= count {
            found.add("/reference_index", reference_beyond(self.reference_index as usize, count));
        }
        if let Some(orientation) = self.orientation.filter(|orientation| !(1..=8).contains(orientation)) {
            found.add("/orientation", format!("orientation is {orientation}; it must be 1 to 8, or null if unknown"));
        }
        for (i, homography) in self.homographies.iter().enumerate() {
            if let Some(why) = homography.violation(self.image_width, self.image_height) {
                found.add_at(i, format!("/homographies/{i}"), format!("the homography of slice {i} {why}"));
            }
        }
        if let Some(reference) = self.homographies.get(self.reference_index as usize) {
            let moved = reference.corner_distance(&Homography::IDENTITY, self.image_width, self.image_height);
            if moved > 0.01 {
                let i = self.reference_index as usize;
                let detail = format!(
                    "slice {i} is the reference, so its homography must be the identity (a corner may move by 0.01 px): \
                     multiply every homography by the inverse of this one, from the left, or set reference_index to the \
                     slice whose homography is the identity"
                );
                found.add_at(i, format!("/homographies/{i}"), detail);
            }
        }
    }

    /// Gains and rail positions.
    fn check_slice_values(&self, found: &mut Violations) {
        let count = self.homographies.len();
        if let Some(gains) = &self.gains {
            if gains.len() != count {
                found.add("/gains", format!("{} gains for {count} slices: give one per slice", gains.len()));
            }
            for (i, gain) in gains.iter().enumerate().filter(|(_, gain)| !(0.05..=20.0).contains(*gain)) {
                let detail = format!("the gain of slice {i} is {gain}; it must be 0.05 to 20");
                found.add_at(i, format!("/gains/{i}"), detail);
            }
        }
        if let Some(rail) = &self.rail_positions_mm {
            if rail.len() != count {
                let detail = format!("{} rail positions for {count} slices: give one per slice", rail.len());
                found.add("/rail_positions_mm", detail);
            }
            if let Some((slice, detail)) = rail_violation(rail) {
                found.add_at(slice, "/rail_positions_mm", detail);
            }
        }
    }

    /// Pixels, lens and magnification.
    fn check_camera(&self, found: &mut Violations) {
        if let Some(pitch) = self.pixel_pitch_mm
            && !(1e-5..=1.0).contains(&pitch)
        {
            found.add("/pixel_pitch_mm", format!("pixel_pitch_mm is {pitch}; it must be 0.00001 to 1"));
        }
        let distance = ("principal_distance_mm", self.principal_distance_mm, [0.1, 1e5]);
        for (name, value, [least, most]) in [distance].into_iter().chain(self.pupils.numbers()) {
            if let Some(value) = value.filter(|value| !(least..=most).contains(value)) {
                found.add(format!("/{name}"), format!("{name} is {value}; it must be {least} to {most}"));
            }
        }
        if let Some(point) = self.principal_point_px {
            let size = [f64::from(self.image_width), f64::from(self.image_height)];
            // the axis of a shifted lens may be outside of the image, but not far
            if !(0..2).all(|a| (-4.0 * size[a]..=5.0 * size[a]).contains(&point[a])) {
                let detail = format!(
                    "principal_point_px is {point:?}, far outside the image; x must be {} to {}, and y {} to {}",
                    -4.0 * size[0],
                    5.0 * size[0],
                    -4.0 * size[1],
                    5.0 * size[1]
                );
                found.add("/principal_point_px", detail);
            }
        }
        if let Some(magnification) = self.magnification
            && !(1e-4..=1e3).contains(&magnification)
        {
            found.add("/magnification", format!("magnification is {magnification}; it must be 0.0001 to 1000"));
        }
        if let Some(distortion) = &self.distortion
            && let Some(why) = distortion.violation(self.image_width, self.image_height)
        {
            found.add("/distortion", format!("the distortion {why}"));
        }
        if let Some(why) = self.lateral_colour.as_ref().and_then(LateralColour::violation) {
            found.add("/lateral_colour", format!("lateral_colour {why}"));
        }
    }
}

/// The rules that a profile violates.
#[derive(Default)]
struct Violations(Vec<ErrorLocation>);

impl Violations {
    fn add(&mut self, pointer: impl Into<String>, detail: impl Into<String>) {
        self.push(pointer.into(), detail.into(), None);
    }

    /// One that concerns slice `i`.
    fn add_at(&mut self, i: usize, pointer: impl Into<String>, detail: impl Into<String>) {
        self.push(pointer.into(), detail.into(), Some(i as u32));
    }

    fn push(&mut self, pointer: String, detail: String, slice: Option<u32>) {
        self.0.push(ErrorLocation { detail, pointer: Some(pointer), file: None, slice });
    }
}

/// That a reference slice is beyond the slices of a stack, as a sentence.
pub(super) fn reference_beyond(index: usize, count: usize) -> String {
    format!(
        "reference_index is {index}, but the stack has {count} slices: use an index from 0 to {}",
        count.saturating_sub(1)
    )
}

/// The first slice whose rail position is out of range or does not continue the direction of those before it, with a
/// sentence about it; `None` when the positions are valid.
pub(super) fn rail_violation(rail: &[f64]) -> Option<(usize, String)> {
    if let Some(slice) = rail.iter().position(|z| !RAIL_MM.contains(z)) {
        let detail = format!(
            "the rail position of slice {slice} is {:e} mm; it must be {:e} to {:e}",
            rail[slice],
            RAIL_MM.start(),
            RAIL_MM.end()
        );
        return Some((slice, detail));
    }
    let is_rising = rail.len() > 1 && rail[1] > rail[0];
    let continues = |w: &[f64]| if is_rising { w[1] > w[0] } else { w[1] < w[0] };
    let slice = rail.windows(2).position(|w| !continues(w))? + 1;
    let detail = format!(
        "rail_positions_mm must increase from slice to slice, or decrease from slice to slice, but slice {} is at {} mm \
         and slice {slice} at {} mm{}",
        slice - 1,
        rail[slice - 1],
        rail[slice],
        if slice > 1 { ", against the direction of the slices before" } else { "" }
    );
    Some((slice, detail))
}

/// One slice of a profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProfileSlice {
    /// 0-based.
    pub index: u32,
    /// Slice pixel -> reference-slice pixel.
    pub homography: Homography,
    /// Local magnification of the homography at the image centre.
    pub scale: f64,
    /// Displacement of the image centre, `[x, y]` px.
    pub shift_px: [f64; 2],
    /// Factor that matches the brightness to the reference slice.
    pub gain: f64,
    /// Dots found in this slice; null for a profile that was not calibrated.
    pub dots_found: Option<u32>,
    /// Inliers of the homography; null for a profile that was not calibrated.
    pub inliers: Option<u32>,
    /// RMS distance of the inliers in the reference slice, px; null for a profile that was not calibrated, and where no
    /// dot was used.
    pub rms_px: Option<f64>,
    /// 95th percentile of that distance, px; null where `rms_px` is.
    pub p95_px: Option<f64>,
    /// Standard deviation of the worst image corner, propagated from the dots, px; null for a profile that was not
    /// calibrated.
    pub corner_sigma_px: Option<f64>,
    /// True when the homography was predicted by the rail law, because the dots of the slice could not be measured or
    /// were too uncertain.
    pub interpolated: bool,
}

impl ProfileSlice {
    /// The slices of an uploaded profile.
    pub fn all_given(input: &ProfileInput) -> Vec<Self> {
        (0..)
            .zip(input.homographies.iter().enumerate())
            .map(|(index, (i, &h))| Self::given(index, h, input.gain(i), input.image_width, input.image_height))
            .collect()
    }

    /// A slice with the values that follow from its homography and gain.
    pub fn given(index: u32, homography: Homography, gain: f64, width: u32, height: u32) -> Self {
        let centre = [(f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0];
        let moved = homography.apply(centre);
        Self {
            index,
            homography,
            scale: homography.scale_at(centre),
            shift_px: [moved[0] - centre[0], moved[1] - centre[1]],
            gain,
            dots_found: None,
            inliers: None,
            rms_px: None,
            p95_px: None,
            corner_sigma_px: None,
            interpolated: false,
        }
    }
}
