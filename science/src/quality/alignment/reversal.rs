//! Reversal: whether the slices run in the opposite direction to the profile.

use crate::types::Homography;
use crate::types::metrics::ResidualSimilarity;

/// A reversed stack must leave a corner drift of at least this to be distinguishable from an exact profile, px ...
const LEAST_PX: f64 = 2.0;
/// ... and the measured drift may differ from it by at most this share.
const UNEXPLAINED: f64 = 0.35;

/// Whether the residual similarity between neighbours is the one that the profile leaves in a reversed stack.
///
/// With the homographies `H_0` to `H_(N-1)`, slice `n` of a reversed stack was taken at the position of slice `N-1-n`.
/// From slice `n` to slice `n+1` its content moves by `H_(n+1) H_(N-2-n)^-1 H_(N-1-n) H_n^-1`. No disturbed rig does
/// this by chance: the residual scale is twice the step of the profile.
pub(super) fn fits_reversed_stack(
    residual: &ResidualSimilarity,
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
        let found = displacement(residual, corner, [right / 2.0, bottom / 2.0]).map(|by| by * last as f64);
        largest = largest.max(expected[0].hypot(expected[1]));
        rest = rest.max((found[0] - expected[0]).hypot(found[1] - expected[1]));
    }
    largest.is_finite() && largest >= LEAST_PX && rest <= UNEXPLAINED * largest
}

/// Displacement of `place` by a similarity about `centre`, in one step, px.
fn displacement(residual: &ResidualSimilarity, place: [f64; 2], centre: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = residual.rotation_deg.to_radians().sin_cos();
    let (a, b) = (residual.scale * cos - 1.0, residual.scale * sin);
    let (x, y) = (place[0] - centre[0], place[1] - centre[1]);
    [a * x - b * y + residual.shift_px[0], b * x + a * y + residual.shift_px[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (600, 400);

    /// Homographies of nine slices, each larger than the previous one by `step` and shifted by `shift` px.
    fn profile(step: f64, shift: f64) -> Vec<Homography> {
        let of = |n: i32| {
            let scale = step.powi(n - 4);
            let centre = |length: usize| (length as f64 - 1.0) / 2.0 * (1.0 - scale);
            Homography::similarity(scale, [centre(SIZE.0) + shift * f64::from(n - 4), centre(SIZE.1)])
        };
        (0..9).map(of).collect()
    }

    fn residual(scale: f64, shift: f64) -> ResidualSimilarity {
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
        // a reversed stack is warped by the inverse of the scale that it needs: twice the step remains
        assert!(fits_reversed_stack(&residual(1.004f64.powi(2), 0.0), &profile, SIZE));
        assert!(fits_reversed_stack(&residual(1.0076, 0.1), &profile, SIZE));
        for other in
            [residual(1.0, 0.0), residual(1.004, 0.0), residual(0.992, 0.0), residual(1.016, 0.0), residual(1.008, 3.0)]
        {
            assert!(!fits_reversed_stack(&other, &profile, SIZE), "{other:?}");
        }
    }

    #[test]
    fn a_profile_that_is_its_own_reverse_detects_no_reversal() {
        let still = vec![Homography::IDENTITY; 9];
        assert!(!fits_reversed_stack(&residual(1.0, 0.0), &still, SIZE));
        assert!(!fits_reversed_stack(&residual(1.0, 0.0), &[], SIZE));
        let shifted = profile(1.0, 1.5);
        assert!(fits_reversed_stack(&residual(1.0, 3.0), &shifted, SIZE));
        assert!(!fits_reversed_stack(&residual(1.0, -3.0), &shifted, SIZE));
    }
}
