//! The height at which each slice is focused: its unit, its zero and its direction.

pub use crate::types::height::{HeightDirection, HeightUnit};
use crate::types::profile::{CaptureMode, ProfileInput};

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
    /// Let `z_i` be the rail position of slice `i`, which increases towards the object, `r` the reference slice, `d2`
    /// the principal distance, `M` the magnification, `f = d2 / (1 + M)`, and `a(d) = f d / (d - f)` (thin lens).
    ///
    /// | capture mode | known | unit | height of slice `i` |
    /// |---|---|---|---|
    /// | fixed lens | rail, `d2`, `M` | mm | `a(d2) - a(d2 - z_i + z_r)` |
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
        match profile.capture_mode {
            Some(CaptureMode::MovingLens) => towards_camera(HeightUnit::Mm, travel),
            Some(CaptureMode::FixedLens) => match thin_lens(profile, &travel) {
                Some(heights) => towards_camera(HeightUnit::Mm, heights),
                None => towards_camera(HeightUnit::RailMm, travel),
            },
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

/// The heights in the object for a fixed lens whose sensor is `travel[i]` mm farther from the lens than in the
/// reference slice. `None` if the camera data are incomplete or contradict the travel.
fn thin_lens(profile: &ProfileInput, travel: &[f64]) -> Option<Vec<f64>> {
    let (d2, magnification) = (profile.principal_distance_mm?, profile.magnification?);
    let focal = d2 / (1.0 + magnification);
    let object = |d2: f64| focal * d2 / (d2 - focal);
    // nothing at a finite distance is in focus on a sensor at the focal plane or in front of it
    let in_focus = travel.iter().all(|travel| d2 + travel > 1.001 * focal);
    let heights: Vec<f64> = travel.iter().map(|travel| object(d2) - object(d2 + travel)).collect();
    (in_focus && monotone(&heights)).then_some(heights)
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
    use crate::{synth::Rig, types::Homography};

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
    fn with_a_fixed_lens_the_height_is_the_distance_of_the_planes_in_focus() {
        let rig = Rig::sized(640, 480, 5);
        let profile = ProfileInput {
            reference_index: rig.reference as u32,
            homographies: vec![Homography::IDENTITY; 5],
            // the rail of a profile counts towards the object, that of the rig away from it
            rail_positions_mm: Some(rig.rail_mm.iter().map(|z| -z).collect()),
            capture_mode: Some(CaptureMode::FixedLens),
            principal_distance_mm: Some(rig.sensor_distance(rig.reference)),
            magnification: Some(rig.magnification),
            ..ProfileInput::default()
        };
        let axis = HeightAxis::from_profile(&profile, None);
        assert_eq!((axis.unit, axis.direction), (HeightUnit::Mm, HeightDirection::TowardsCamera));
        let distance = |i: usize| rig.object_distance(rig.focus_fraction(i));
        for (i, height) in axis.heights.iter().enumerate() {
            assert!((height - (distance(rig.reference) - distance(i))).abs() < 1e-9, "slice {i}");
        }
        assert!(axis.heights[0] > 1.0, "the first slice is focused nearest");
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
