//! Drift: how far a rig moved between two profiles, from the image corners of each slice.

use crate::types::{Homography, profile::ProfileInput, report::Drift};

/// Up to this movement of an image corner, in px, the rig counts as unmoved: it is three standard deviations of a
/// corner of a good calibration.
pub const NO_MOVEMENT_PX: f64 = 0.3;
/// Up to this movement of an image corner, in px, the rig counts as slightly moved. Beyond it, stacks may be affected.
pub const SMALL_MOVEMENT_PX: f64 = 1.0;

/// Compares two profiles of one rig and lens: how far the image corners of each slice moved, and how the gains changed.
/// Each profile comes with its revision number; `from` is the older one.
///
/// The corners are compared as they are seen, so it does not matter whether a profile knows the distortion of the lens.
/// Profiles with different image sizes or slice counts cannot be compared. Every distance is then `None`, and `detail`
/// gives the reason.
///
/// # Example
/// ```
/// use pinstack_science::calibration::drift;
/// use pinstack_science::types::{Homography, profile::ProfileInput};
///
/// let homographies = vec![Homography::IDENTITY; 2];
/// let before = ProfileInput { image_width: 200, image_height: 100, homographies, ..ProfileInput::default() };
/// let mut after = before.clone();
/// after.homographies[1] = Homography::similarity(1.0, [3.0, 4.0]);
/// let moved = drift((1, &before), (2, &after));
/// assert_eq!((moved.worst_slice, moved.worst_px), (Some(1), Some(5.0)));
/// ```
pub fn drift(from: (u32, &ProfileInput), to: (u32, &ProfileInput)) -> Drift {
    let ((from_revision, old), (to_revision, new)) = (from, to);
    let slices = old.homographies.len().max(new.homographies.len());
    let incomparable = |detail: String| Drift {
        from_revision,
        to_revision,
        corner_px: vec![None; slices],
        worst_px: None,
        worst_slice: None,
        gain_ratio: vec![None; slices],
        detail,
    };
    if let Some(why) = why_incomparable(from, to) {
        return incomparable(why);
    }
    let Some(rebased) = Rebased::on(old, new.reference_index as usize) else {
        let detail = format!(
            "revision {from_revision} cannot be rebased on slice {}: its homography is singular",
            new.reference_index
        );
        return incomparable(detail);
    };
    let gains = gains(new);
    let corner_px: Vec<Option<f64>> = new
        .homographies
        .iter()
        .zip(&rebased.homographies)
        .map(|(new_homography, old_homography)| {
            let old_homography = (*old_homography)?;
            let moved = Homography::corners(new.image_width, new.image_height).map(|corner| {
                let (a, b) = (seen(old, &old_homography, corner), seen(new, new_homography, corner));
                (a[0] - b[0]).hypot(a[1] - b[1])
            });
            moved.into_iter().try_fold(0.0_f64, |worst, moved| moved.is_finite().then(|| worst.max(moved)))
        })
        .collect();
    let gain_ratio = gains.iter().zip(&rebased.gains).map(|(new, old)| ratio(*new, *old)).collect();
    let known = corner_px.iter().enumerate().filter_map(|(slice, moved)| moved.map(|moved| (slice, moved)));
    let Some((worst_slice, worst)) = known.max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return incomparable("no slice has finite corner positions in both revisions".to_owned());
    };
    Drift {
        from_revision,
        to_revision,
        worst_px: Some(worst),
        worst_slice: Some(worst_slice as u32),
        gain_ratio,
        detail: sentence(worst, worst_slice, from_revision),
        corner_px,
    }
}

fn sentence(worst: f64, slice: usize, since: u32) -> String {
    match worst {
        w if w <= NO_MOVEMENT_PX => {
            format!(
                "the rig has not moved since revision {since}: no corner is off by more than {worst:.2} px (slice {slice})"
            )
        }
        w if w <= SMALL_MOVEMENT_PX => {
            format!("the rig moved slightly since revision {since}: slice {slice} most, {worst:.2} px at a corner")
        }
        _ => format!(
            "slice {slice} moved most: {worst:.1} px at a corner since revision {since}; stacks taken since then may be affected"
        ),
    }
}

/// Why two profiles cannot be compared.
fn why_incomparable((from, old): (u32, &ProfileInput), (to, new): (u32, &ProfileInput)) -> Option<String> {
    let sizes = [(old.image_width, old.image_height), (new.image_width, new.image_height)];
    if sizes[0] != sizes[1] {
        let [(a, b), (c, d)] = sizes;
        return Some(format!(
            "revisions {from} and {to} cannot be compared: their slices are {a} x {b} and {c} x {d} px"
        ));
    }
    let counts = [old.homographies.len(), new.homographies.len()];
    if counts[0] != counts[1] {
        return Some(format!(
            "revisions {from} and {to} cannot be compared: they have {} and {} slices",
            counts[0], counts[1]
        ));
    }
    if new.reference_index as usize >= counts[1] {
        return Some(format!(
            "revisions {from} and {to} cannot be compared: the reference slice of revision {to} is slice {}, but it has \
             {} slices",
            new.reference_index, counts[1]
        ));
    }
    None
}

/// Where the point `p` of a slice, px, is in the reference slice, as both are seen: with the distortion of the profile.
fn seen(profile: &ProfileInput, homography: &Homography, p: [f64; 2]) -> [f64; 2] {
    match &profile.distortion {
        Some(distortion) => distortion.distort(homography.apply(distortion.undistort(p))),
        None => homography.apply(p),
    }
}

/// A profile rebased on another of its slices.
struct Rebased {
    homographies: Vec<Option<Homography>>,
    gains: Vec<f64>,
}

impl Rebased {
    /// `None` when slice `reference` is missing or its homography has no inverse.
    fn on(profile: &ProfileInput, reference: usize) -> Option<Self> {
        let gains = gains(profile);
        if reference == profile.reference_index as usize {
            return Some(Self { homographies: profile.homographies.iter().copied().map(Some).collect(), gains });
        }
        let back = profile.homographies.get(reference)?.inverse()?;
        let gain = *gains.get(reference)?;
        Some(Self {
            homographies: profile.homographies.iter().map(|homography| homography.then(&back)).collect(),
            gains: gains.into_iter().map(|own| own / gain).collect(),
        })
    }
}

/// The gains of a profile, 1 where it has none.
fn gains(profile: &ProfileInput) -> Vec<f64> {
    let given = |i: usize| profile.gains.as_ref().and_then(|gains| gains.get(i)).copied().unwrap_or(1.0);
    (0..profile.homographies.len()).map(given).collect()
}

fn ratio(new: f64, old: f64) -> Option<f64> {
    Some(new / old).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::distortion::Distortion;

    /// A rail of `count` slices of 200 x 100 px; the image grows by `growth` per slice.
    fn profile(count: usize, reference: usize, growth: f64) -> ProfileInput {
        let scale = |i: usize| 1.0 + growth * (i as f64 - reference as f64);
        ProfileInput {
            image_width: 200,
            image_height: 100,
            reference_index: reference as u32,
            homographies: (0..count).map(|i| Homography::similarity(scale(i), [0.0; 2])).collect(),
            gains: Some((0..count).map(|i| 1.0 + 0.01 * (i as f64 - reference as f64)).collect()),
            ..ProfileInput::default()
        }
    }

    #[test]
    fn a_rig_that_did_not_move_is_reported_as_unmoved() {
        let found = drift((3, &profile(5, 2, 0.01)), (4, &profile(5, 2, 0.0101)));
        assert!(found.worst_px.is_some_and(|worst| worst < 0.1), "{found:?}");
        assert!(found.detail.contains("has not moved since revision 3"), "{}", found.detail);
        assert_eq!((found.from_revision, found.to_revision, found.gain_ratio), (3, 4, vec![Some(1.0); 5]));
    }

    #[test]
    fn the_slice_that_moved_most_is_named_with_its_distance() {
        let old = profile(9, 4, 0.01);
        let mut new = old.clone();
        new.homographies[7].0[2] += 1.8;
        let found = drift((3, &old), (5, &new));
        assert_eq!(found.worst_slice, Some(7));
        assert!(
            found.corner_px.iter().enumerate().all(|(i, moved)| moved.is_some_and(|m| (m > 1.0) == (i == 7))),
            "{found:?}"
        );
        assert_eq!(
            found.detail,
            "slice 7 moved most: 1.8 px at a corner since revision 3; stacks taken since then may be affected"
        );
        new.homographies[7].0[2] -= 1.2;
        assert!(drift((3, &old), (5, &new)).detail.contains("moved slightly since revision 3: slice 7 most, 0.60 px"));
    }

    #[test]
    fn a_change_of_the_reference_slice_is_no_movement() {
        let old = profile(5, 1, 0.01);
        let back = old.homographies[3].inverse().expect("regular");
        let new = ProfileInput {
            reference_index: 3,
            homographies: old.homographies.iter().map(|h| h.then(&back).expect("regular")).collect(),
            gains: old.gains.as_ref().map(|gains| gains.iter().map(|gain| gain / gains[3]).collect()),
            ..old.clone()
        };
        let found = drift((1, &old), (2, &new));
        assert!(found.worst_px.is_some_and(|worst| worst < 1e-9), "{found:?}");
        assert!(found.gain_ratio.iter().all(|ratio| ratio.is_some_and(|r| (r - 1.0).abs() < 1e-9)), "{found:?}");
    }

    #[test]
    fn slices_are_compared_as_they_are_seen_when_the_profiles_have_distortion() {
        // the same rig, once with the distortion that only a later calibration measured
        let seen = profile(5, 2, 0.01);
        let distortion = Distortion { centre_px: [99.5, 49.5], k1: 0.02, k2: 0.0, radius_px: 111.0 };
        let with = ProfileInput { distortion: Some(distortion), ..seen.clone() };
        let found = drift((1, &seen), (2, &with));
        let largest = Homography::corners(200, 100).map(|corner| {
            let sent = with.homographies[4].apply(distortion.undistort(corner));
            let (a, b) = (distortion.distort(sent), seen.homographies[4].apply(corner));
            (a[0] - b[0]).hypot(a[1] - b[1])
        });
        let largest = largest.into_iter().fold(0.0, f64::max);
        assert!(largest > 0.01 && (found.corner_px[4].expect("compared") - largest).abs() < 1e-9, "{found:?}");
        // the reference slice has not moved, whatever the lens does
        assert!(found.corner_px[2].is_some_and(|moved| moved < 1e-6), "{found:?}");
    }

    #[test]
    fn a_reference_slice_beyond_the_slices_is_named() {
        let old = profile(5, 2, 0.01);
        let new = ProfileInput { reference_index: 7, ..old.clone() };
        let found = drift((1, &old), (2, &new));
        assert!(found.detail.contains("the reference slice of revision 2 is slice 7"), "{}", found.detail);
        assert_eq!(found.worst_px, None);
    }

    #[test]
    fn profiles_of_different_sizes_or_counts_are_not_compared() {
        let old = profile(5, 2, 0.01);
        let wider = ProfileInput { image_width: 300, ..old.clone() };
        let found = drift((1, &old), (2, &wider));
        assert_eq!((found.worst_px, found.worst_slice, found.corner_px.len()), (None, None, 5));
        assert!(found.detail.contains("200 x 100 and 300 x 100 px"), "{}", found.detail);
        let longer = drift((1, &old), (2, &profile(6, 2, 0.01)));
        assert!(longer.detail.contains("they have 5 and 6 slices") && longer.corner_px.iter().all(Option::is_none));
    }
}
