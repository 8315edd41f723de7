//! How far a rig moved between two profiles.

use crate::types::{Homography, profile::ProfileInput, report::Drift};

/// Largest movement of a corner that counts as none, px: the uncertainty of a good calibration.
pub(super) const STILL: f64 = 0.3;
/// Largest movement of a corner that counts as little, px.
pub(super) const LITTLE: f64 = 1.0;

/// How far the image corners of each slice, and the gains, moved from one profile to another. Each profile comes with
/// its revision; the older one is `from`.
///
/// When the two have different reference slices, the older one is first mapped to the reference slice of the newer.
/// Distances are px of that reference slice. Nothing can be told when the image size or the number of slices differ; the sentence
/// says so then, and every distance is `None`.
pub fn drift(from: (u32, &ProfileInput), to: (u32, &ProfileInput)) -> Drift {
    let ((from_revision, old), (to_revision, new)) = (from, to);
    let slices = old.homographies.len().max(new.homographies.len());
    let untold = |detail: String| Drift {
        from_revision,
        to_revision,
        corner_px: vec![None; slices],
        worst_px: None,
        worst_slice: None,
        gain_ratio: vec![None; slices],
        detail,
    };
    if let Some(why) = objection(from, to) {
        return untold(why);
    }
    let Some(based) = Based::on(old, new.reference_index as usize) else {
        let detail = format!(
            "revision {from_revision} cannot be mapped to slice {}: its homography is singular",
            new.reference_index
        );
        return untold(detail);
    };
    let gains = gains(new);
    let corner_px: Vec<Option<f64>> = new
        .homographies
        .iter()
        .zip(&based.homographies)
        .map(|(new_way, old_way)| {
            let way = old_way.as_ref()?.corner_distance(new_way, new.image_width, new.image_height);
            way.is_finite().then_some(way)
        })
        .collect();
    let gain_ratio = gains.iter().zip(&based.gains).map(|(new, old)| ratio(*new, *old)).collect();
    let told = corner_px.iter().enumerate().filter_map(|(slice, way)| way.map(|way| (slice, way)));
    let Some((worst_slice, worst)) = told.max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return untold("no corner of any slice can be followed from one revision to the other".to_owned());
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
        w if w <= STILL => {
            format!(
                "the rig has not moved since revision {since}: no corner is off by more than {worst:.2} px (slice {slice})"
            )
        }
        w if w <= LITTLE => {
            format!("the rig moved a little since revision {since}: slice {slice} most, {worst:.2} px at a corner")
        }
        _ => format!(
            "slice {slice} moved most: {worst:.1} px at a corner since revision {since}; stacks taken since then may be affected"
        ),
    }
}

/// Why two profiles cannot be compared.
fn objection((from, old): (u32, &ProfileInput), (to, new): (u32, &ProfileInput)) -> Option<String> {
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
    None
}

/// A profile mapped to another of its slices.
struct Based {
    homographies: Vec<Option<Homography>>,
    gains: Vec<f64>,
}

impl Based {
    /// `None` when the slice has no way back or is missing.
    fn on(profile: &ProfileInput, reference: usize) -> Option<Self> {
        let gains = gains(profile);
        if reference == profile.reference_index as usize {
            return Some(Self { homographies: profile.homographies.iter().copied().map(Some).collect(), gains });
        }
        let back = profile.homographies.get(reference)?.inverse()?;
        let gain = *gains.get(reference)?;
        Some(Self {
            homographies: profile.homographies.iter().map(|way| way.then(&back)).collect(),
            gains: gains.into_iter().map(|own| own / gain).collect(),
        })
    }
}

/// The gains, 1 where none were given.
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
    fn a_rig_that_did_not_move_is_said_not_to_have_moved() {
        let told = drift((3, &profile(5, 2, 0.01)), (4, &profile(5, 2, 0.0101)));
        assert!(told.worst_px.is_some_and(|worst| worst < 0.1), "{told:?}");
        assert!(told.detail.contains("has not moved since revision 3"), "{}", told.detail);
        assert_eq!((told.from_revision, told.to_revision, told.gain_ratio), (3, 4, vec![Some(1.0); 5]));
    }

    #[test]
    fn the_slice_that_moved_most_is_named_with_its_distance() {
        let old = profile(9, 4, 0.01);
        let mut new = old.clone();
        new.homographies[7].0[2] += 1.8;
        let told = drift((3, &old), (5, &new));
        assert_eq!(told.worst_slice, Some(7));
        assert!(
            told.corner_px.iter().enumerate().all(|(i, way)| way.is_some_and(|w| (w > 1.0) == (i == 7))),
            "{told:?}"
        );
        assert_eq!(
            told.detail,
            "slice 7 moved most: 1.8 px at a corner since revision 3; stacks taken since then may be affected"
        );
        new.homographies[7].0[2] -= 1.2;
        assert!(drift((3, &old), (5, &new)).detail.contains("moved a little since revision 3: slice 7 most, 0.60 px"));
    }

    #[test]
    fn another_reference_slice_is_no_movement() {
        let old = profile(5, 1, 0.01);
        let back = old.homographies[3].inverse().expect("a way back");
        let new = ProfileInput {
            reference_index: 3,
            homographies: old.homographies.iter().map(|way| way.then(&back).expect("a way")).collect(),
            gains: old.gains.as_ref().map(|gains| gains.iter().map(|gain| gain / gains[3]).collect()),
            ..old.clone()
        };
        let told = drift((1, &old), (2, &new));
        assert!(told.worst_px.is_some_and(|worst| worst < 1e-9), "{told:?}");
        assert!(told.gain_ratio.iter().all(|ratio| ratio.is_some_and(|ratio| (ratio - 1.0).abs() < 1e-9)), "{told:?}");
    }

    #[test]
    fn other_sizes_and_counts_are_told_instead_of_a_distance() {
        let old = profile(5, 2, 0.01);
        let wider = ProfileInput { image_width: 300, ..old.clone() };
        let told = drift((1, &old), (2, &wider));
        assert_eq!((told.worst_px, told.worst_slice, told.corner_px.len()), (None, None, 5));
        assert!(told.detail.contains("200 x 100 and 300 x 100 px"), "{}", told.detail);
        let longer = drift((1, &old), (2, &profile(6, 2, 0.01)));
        assert!(longer.detail.contains("they have 5 and 6 slices") && longer.corner_px.iter().all(Option::is_none));
    }
}
