//! The height at which each slice is focused: its unit, its zero and its direction.

pub use crate::types::height::{HeightDirection, HeightUnit};
use crate::types::{
    lens::Lens,
    profile::{CaptureMode, ProfileInput},
};

/// The heights of the planes that the slices are focused on.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightAxis {
    /// Unit of the heights.
    pub unit: HeightUnit,
    /// Direction in which they increase.
    pub direction: HeightDirection,
    /// Height per slice, strictly monotone; 0 in the reference slice.
    pub heights: Vec<f64>,
}

impl HeightAxis {
    /// The axis of a stack taken with the rig of `profile`. `near_first`: whether the first slice is focused nearest to
    /// the camera.
    ///
    /// Let `z_i` be the rail position of slice `i`, which increases towards the object, `r` the reference slice, and
    /// `h` the shift of the plane in focus by [`Lens::focus_shift`].
    ///
    /// | capture mode | known | unit | height of slice `i` |
    /// |---|---|---|---|
    /// | fixed lens, lens alone | rail, lens | mm | `h(z_i - z_r)` |
    /// | moving lens | rail | mm | `z_r - z_i` |
    /// | other | rail | mm of the rail | `z_r - z_i` |
    /// | any | nothing | steps | `r - i` if the first slice is nearest, else `i - r` |
    pub fn from_profile(profile: &ProfileInput, near_first: Option<bool>) -> Self {
        let count = profile.homographies.len();
        let reference = (profile.reference_index as usize).min(count.saturating_sub(1));
        let Some(rail) = profile.rail_positions_mm.as_deref().filter(|rail| rail.len() == count && monotone(rail))
        else {
            return Self::steps(count, reference, near_first);
        };
        let towards_camera = |unit, heights| Self { unit, direction: HeightDirection::TowardsCamera, heights };
        let travel: Vec<f64> = rail.iter().map(|z| rail[reference] - z).collect();
        match profile.capture_mode.and_then(|mode| in_object(profile, mode, &travel)) {
            Some(heights) => towards_camera(HeightUnit::Mm, heights),
            None => towards_camera(HeightUnit::RailMm, travel),
        }
    }

    /// Steps from slice to slice.
    pub fn steps(count: usize, reference: usize, near_first: Option<bool>) -> Self {
        let (sign, direction) = match near_first {
            Some(true) => (-1.0, HeightDirection::TowardsCamera),
            Some(false) => (1.0, HeightDirection::TowardsCamera),
            None => (1.0, HeightDirection::WithSliceNumber),
        };
        let heights = (0..count).map(|i| sign * (i as f64 - reference as f64)).collect();
        Self { unit: HeightUnit::Steps, direction, heights }
    }
}

/// The heights in the object; `travel[i]`: how much farther from the object the rail is than in the reference slice.
/// `None` if the data of the lens are incomplete or contradict the travel.
fn in_object(profile: &ProfileInput, mode: CaptureMode, travel: &[f64]) -> Option<Vec<f64>> {
    if mode == CaptureMode::MovingLens {
        return Some(travel.to_vec());
    }
    let lens = lens(profile)?;
    // nothing at a finite distance is in focus on a sensor at the focal plane or in front of it
    let in_focus = travel.iter().all(|travel| {
        let away = if mode == CaptureMode::FixedLens { *travel } else { -travel };
        lens.with_sensor_moved(away).magnification > 1e-3
    });
    let heights: Vec<f64> = travel.iter().map(|travel| lens.focus_shift(mode, -travel)).collect();
    (in_focus && monotone(&heights)).then_some(heights)
}

/// The lens by the profile: from the distance `E` of the exit pupil, or from the principal distance, which is `E / P`.
/// Without a pupil ratio it is taken for 1: heights are `t / M^2` to first order, whatever the focal length, and over a
/// stack in which the image grows by 5 % the next order is wrong by at most 2.5 %.
fn lens(profile: &ProfileInput) -> Option<Lens> {
    let pupils = &profile.pupils;
    let ratio = match (pupils.pupil_ratio, pupils.exit_pupil_distance_mm, profile.principal_distance_mm) {
        (Some(ratio), _, _) => ratio,
        (None, Some(exit), Some(principal)) => exit / principal,
        (None, _, _) => 1.0,
    };
    let exit = pupils.exit_pupil_distance_mm.or(profile.principal_distance_mm.map(|principal| principal * ratio))?;
    Some(Lens::of_exit_pupil(exit, profile.magnification?, ratio))
}

/// Whether the values are finite and strictly increase or decrease.
pub(super) fn monotone(values: &[f64]) -> bool {
    let rising = values.windows(2).all(|pair| pair[0] < pair[1]);
    let falling = values.windows(2).all(|pair| pair[0] > pair[1]);
    (rising || falling) && values.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        synth::Rig,
        types::{Homography, pupils::Pupils},
    };

    fn profile(mode: Option<CaptureMode>, rail: Option<Vec<f64>>) -> ProfileInput {
        ProfileInput {
            reference_index: 1,
            homographies: vec![Homography::IDENTITY; 4],
            rail_positions_mm: rail,
            capture_mode: mode,
            ..ProfileInput::default()
        }
    }

    #[test]
    fn the_unit_follows_from_what_the_profile_knows() {
        let rail = Some(vec![0.0, 1.0, 3.0, 4.0]);
        for (mode, rail, near, unit, direction, heights) in [
            (None, None, None, HeightUnit::Steps, HeightDirection::WithSliceNumber, [-1.0, 0.0, 1.0, 2.0]),
            (None, None, Some(true), HeightUnit::Steps, HeightDirection::TowardsCamera, [1.0, 0.0, -1.0, -2.0]),
            (None, rail.clone(), None, HeightUnit::RailMm, HeightDirection::TowardsCamera, [1.0, 0.0, -2.0, -3.0]),
            (
                Some(CaptureMode::MovingLens),
                rail.clone(),
                None,
                HeightUnit::Mm,
                HeightDirection::TowardsCamera,
                [1.0, 0.0, -2.0, -3.0],
            ),
            // neither principal distance nor magnification
            (
                Some(CaptureMode::FixedLens),
                rail,
                None,
                HeightUnit::RailMm,
                HeightDirection::TowardsCamera,
                [1.0, 0.0, -2.0, -3.0],
            ),
        ] {
            let axis = HeightAxis::from_profile(&profile(mode, rail), near);
            assert_eq!((axis.unit, axis.direction, &axis.heights[..]), (unit, direction, &heights[..]));
        }
    }

    #[test]
    fn the_height_is_the_distance_of_the_planes_in_focus_of_lenses_with_any_pupils() {
        for (pupil_ratio, mode) in [
            (1.0, CaptureMode::FixedLens),
            (0.6, CaptureMode::FixedLens),
            (1.8, CaptureMode::FixedLens),
            (1.8, CaptureMode::LensAlone),
        ] {
            let rig = Rig { pupil_ratio, mode, magnification: 1.6, ..Rig::sized(640, 480, 5) };
            // the rail of a profile counts towards the object, and the sensor of the rig away from it
            let sign = if mode == CaptureMode::FixedLens { -1.0 } else { 1.0 };
            let known = ProfileInput {
                reference_index: rig.reference as u32,
                homographies: vec![Homography::IDENTITY; 5],
                rail_positions_mm: Some(rig.rail_mm.iter().map(|z| sign * z).collect()),
                capture_mode: Some(mode),
                principal_distance_mm: Some(rig.principal_distance(rig.reference)),
                pupils: Pupils { pupil_ratio: Some(pupil_ratio), ..Pupils::default() },
                magnification: Some(rig.magnification),
                ..ProfileInput::default()
            };
            let axis = HeightAxis::from_profile(&known, None);
            assert_eq!((axis.unit, axis.direction), (HeightUnit::Mm, HeightDirection::TowardsCamera));
            let distance = |i: usize| rig.object_distance(rig.focus_fraction(i));
            for (i, height) in axis.heights.iter().enumerate() {
                let truth = distance(rig.reference) - distance(i);
                assert!((height - truth).abs() < 1e-9, "slice {i}: {height} for {truth}");
            }
            assert!(axis.heights[0].abs() > 1.0);
            // without a pupil ratio the distance of the exit pupil gives the first order
            let exit = Pupils { exit_pupil_distance_mm: Some(rig.lens().exit_pupil_distance()), ..Pupils::default() };
            let rough = ProfileInput { principal_distance_mm: None, pupils: exit, ..known };
            let axis = HeightAxis::from_profile(&rough, None);
            for (i, height) in axis.heights.iter().enumerate() {
                let truth = distance(rig.reference) - distance(i);
                assert!((height - truth).abs() <= 0.05 * truth.abs(), "slice {i}: {height} for {truth}");
            }
        }
    }

    #[test]
    fn camera_data_that_contradict_the_rail_give_millimetres_of_the_rail() {
        let contradictory = ProfileInput {
            principal_distance_mm: Some(3.0),
            magnification: Some(1.0),
            ..profile(Some(CaptureMode::FixedLens), Some(vec![0.0, 1.0, 3.0, 4.0]))
        };
        assert_eq!(HeightAxis::from_profile(&contradictory, None).unit, HeightUnit::RailMm);
        let uneven = profile(None, Some(vec![0.0, 2.0, 1.0, 4.0]));
        assert_eq!(HeightAxis::from_profile(&uneven, None).unit, HeightUnit::Steps);
    }
}
