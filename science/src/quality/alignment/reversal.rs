//! Whether the slices run the other way than the profile.

use super::ResidualSimilarity;
use crate::types::Homography;

/// What a reversed stack would leave in the corners must be at least this to be told from nothing, px ...
const LEAST_PX: f64 = 2.0;
/// ... and what is left of it besides at most this share.
const UNEXPLAINED: f64 = 0.35;

/// True when the movement that the profile leaves between neighbours is the one that it would leave in a stack whose
/// slices came from the last to the first.
///
/// With the homographies `H_0` to `H_(N-1)`, slice `n` of such a stack was taken where slice `N-1-n` belongs. From
/// slice `n` to the next its content moves by `H_(n+1) H_(N-2-n)^-1 H_(N-1-n) H_n^-1`, which no rig that was touched
/// does by chance: the scale runs exactly the wrong way.
pub(super) fn fits_reversed_stack(
    left: &ResidualSimilarity,
    homographies: &[Homography],
    (width, height): (usize, usize),
) -> bool {
    let last = homographies.len().saturating_sub(1);
    if last == 0 {
        return false;
    }
    let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
    let step = |n: usize| {
        let to_scene = homographies[n].inverse()?.then(&homographies[last - n])?;
        let from_scene = homographies[last - n - 1].inverse()?.then(&homographies[n + 1])?;
        to_scene.then(&from_scene)
    };
    let Some(steps) = (0..last).map(step).collect::<Option<Vec<Homography>>>() else { return false };
    let (mut largest, mut rest) = (0.0f64, 0.0f64);
    for corner in corners {
        let mut expected = [0.0; 2];
        for step in &steps {
            let to = step.apply(corner);
            expected = [expected[0] + to[0] - corner[0], expected[1] + to[1] - corner[1]];
        }
        let found = moved(left, corner, [right / 2.0, bottom / 2.0]).map(|by| by * last as f64);
        largest = largest.max(expected[0].hypot(expected[1]));
        rest = rest.max((found[0] - expected[0]).hypot(found[1] - expected[1]));
    }
    largest.is_finite() && largest >= LEAST_PX && rest <= UNEXPLAINED * largest
}

/// How far a similarity about `centre` moves `place` in one step.
fn moved(left: &ResidualSimilarity, place: [f64; 2], centre: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = left.rotation_deg.to_radians().sin_cos();
    let (a, b) = (left.scale * cos - 1.0, left.scale * sin);
    let (x, y) = (place[0] - centre[0], place[1] - centre[1]);
    [a * x - b * y + left.shift_px[0], b * x + a * y + left.shift_px[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (600, 400);

    /// Nine slices about the middle, each larger by `step`, shifted by `shift` px.
    fn profile(step: f64, shift: f64) -> Vec<Homography> {
        let of = |n: i32| {
            let scale = step.powi(n - 4);
            let centre = |length: usize| (length as f64 - 1.0) / 2.0 * (1.0 - scale);
            Homography::similarity(scale, [centre(SIZE.0) + shift * f64::from(n - 4), centre(SIZE.1)])
        };
        (0..9).map(of).collect()
    }

    fn left(scale: f64, shift: f64) -> ResidualSimilarity {
        ResidualSimilarity {
            scale,
            rotation_deg: 0.0,
            shift_px: [shift, 0.0],
            corner_drift_px: 0.0,
            corner_drift_sigma_px: 0.1,
            shifts: 100,
        }
    }

    #[test]
    fn the_scale_must_run_the_wrong_way_by_twice_the_step() {
        let profile = profile(1.004, 0.0);
        // what the profile does to a stack that needs the opposite: once too little, once too much
        assert!(fits_reversed_stack(&left(1.004f64.powi(2), 0.0), &profile, SIZE));
        assert!(fits_reversed_stack(&left(1.0076, 0.1), &profile, SIZE));
        for other in [left(1.0, 0.0), left(1.004, 0.0), left(0.992, 0.0), left(1.016, 0.0), left(1.008, 3.0)] {
            assert!(!fits_reversed_stack(&other, &profile, SIZE), "{other:?}");
        }
    }

    #[test]
    fn a_profile_that_reads_the_same_both_ways_tells_nothing() {
        let still = vec![Homography::IDENTITY; 9];
        assert!(!fits_reversed_stack(&left(1.0, 0.0), &still, SIZE));
        assert!(!fits_reversed_stack(&left(1.0, 0.0), &[], SIZE));
        let shifted = profile(1.0, 1.5);
        assert!(fits_reversed_stack(&left(1.0, 3.0), &shifted, SIZE));
        assert!(!fits_reversed_stack(&left(1.0, -3.0), &shifted, SIZE));
    }
}
