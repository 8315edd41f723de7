//! The capture mode: whether the sensor moved alone (fixed lens) or with the lens (moving lens).
//!
//! Two criteria:
//!
//! - Law: with a fixed lens 1/scale is linear in the rail position; with a moving lens and a flat target the scale
//!   itself is. The two differ by half the square of the relative change over the stack.
//! - Direction: towards the object, the image shrinks with a fixed lens (the sensor approaches the lens) and grows with
//!   a moving lens.

use super::statistics::{median, median_of, range};
use crate::types::{profile::CaptureMode, report::CaptureReport};

/// The scale of one measured slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScaleSample {
    /// Rail position: mm towards the object when the user specified positions, else the slice index.
    pub position: f64,
    /// Scale from the slice to the reference slice.
    pub scale: f64,
    /// Standard deviation of the scale.
    pub sigma: f64,
}

/// Decides the capture mode from the scales. `positions_given`: positions came from the user, so the direction
/// criterion applies. `even`: steps are known to be equal, so the law criterion applies. `given`: the mode that the
/// user specified.
pub(super) fn decide(
    slices: &[ScaleSample],
    positions_given: bool,
    even: bool,
    given: Option<CaptureMode>,
) -> CaptureReport {
    let by_law = if even { by_law(slices) } else { None };
    let by_direction = if positions_given { by_direction(slices) } else { None };
    let is_contradictory = by_law.zip(by_direction).is_some_and(|(law, direction)| law != direction);
    let found = by_law.or(by_direction).filter(|_| !is_contradictory);
    let detail = match (found, by_law) {
        _ if is_contradictory => {
            "the law of the scales and the direction of the rail disagree: check that rail positions \
                                  are counted towards the object"
                .to_owned()
        }
        (Some(mode), Some(_)) => format!("the scales follow the law of {}", name(mode)),
        (Some(mode), None) => {
            let change = if mode == CaptureMode::FixedLens { "shrinks" } else { "grows" };
            format!("towards the object the image {change}, as with {}", name(mode))
        }
        (None, _) => {
            "the scales do not show what moved: too few slices, too small a change of scale, or uneven steps".to_owned()
        }
    };
    CaptureReport { told: given, found, detail }
}

/// The mode as a phrase for sentences.
pub(super) fn name(mode: CaptureMode) -> &'static str {
    match mode {
        CaptureMode::FixedLens => "a fixed lens (only the sensor moves)",
        CaptureMode::MovingLens => "a moving lens (camera and lens move together)",
    }
}

fn by_law(slices: &[ScaleSample]) -> Option<CaptureMode> {
    if slices.len() < 5 {
        return None;
    }
    let fixed = off_line(slices.iter().map(|s| (s.position, 1.0 / s.scale)));
    let moving = off_line(slices.iter().map(|s| (s.position, s.scale)));
    let noise = median_of(slices.iter().map(|s| s.sigma)).max(1e-7);
    let certain = |right: f64, wrong: f64| right < 0.25 * wrong && wrong > 5.0 * noise && right < 4.0 * noise;
    match () {
        () if certain(fixed, moving) => Some(CaptureMode::FixedLens),
        () if certain(moving, fixed) => Some(CaptureMode::MovingLens),
        () => None,
    }
}

fn by_direction(slices: &[ScaleSample]) -> Option<CaptureMode> {
    let mut slopes = Vec::new();
    for (k, a) in slices.iter().enumerate() {
        slopes.extend(slices[k + 1..].iter().map(|b| (b.scale - a.scale) / (b.position - a.position)));
    }
    let slope = median(&mut slopes);
    let (low, high) = range(slices.iter().map(|s| s.position));
    let noise = median_of(slices.iter().map(|s| s.sigma)).max(1e-7);
    if slices.len() < 3 || (slope * (high - low)).abs() < 10.0 * noise {
        return None;
    }
    // the scale to the reference slice grows where the image shrinks
    Some(if slope > 0.0 { CaptureMode::FixedLens } else { CaptureMode::MovingLens })
}

/// RMS residual of the least-squares line.
fn off_line(points: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = points.clone().count() as f64;
    let (sx, sy) = points.clone().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    let (mx, my) = (sx / n, sy / n);
    let (xx, xy) = points.clone().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mx).powi(2), s.1 + (p.0 - mx) * (p.1 - my)));
    let slope = xy / xx.max(1e-12);
    (points.map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2)).sum::<f64>() / (n - 2.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(scale: impl Fn(f64) -> f64) -> Vec<ScaleSample> {
        (-4..=4).map(|z| ScaleSample { position: f64::from(z), scale: scale(f64::from(z)), sigma: 3e-6 }).collect()
    }

    #[test]
    fn the_law_of_the_scales_decides_the_capture_mode_only_when_it_is_unambiguous() {
        let fixed = stack(|dz| 141.0 / (141.0 - 3.0 * dz));
        assert_eq!(decide(&fixed, false, true, None).found, Some(CaptureMode::FixedLens));
        assert_eq!(decide(&stack(|dz| 1.0 - dz / 47.0), false, true, None).found, Some(CaptureMode::MovingLens));
        assert_eq!(decide(&stack(|dz| 1.0 - dz / 1e6), false, true, None).found, None);
        assert_eq!(decide(&stack(|dz| 1.0 + 0.01 * (dz * 2.0).sin()), false, true, None).found, None);
        assert_eq!(decide(&fixed, false, false, None).found, None);
    }

    #[test]
    fn the_direction_of_the_rail_decides_too_and_a_contradiction_is_reported() {
        let fixed = stack(|dz| 141.0 / (141.0 - 3.0 * dz));
        assert_eq!(decide(&fixed, true, false, None).found, Some(CaptureMode::FixedLens));
        let moving = stack(|dz| 1.0 - dz / 47.0);
        assert_eq!(decide(&moving, true, false, None).found, Some(CaptureMode::MovingLens));
        let turned = stack(|dz| 141.0 / (141.0 + 3.0 * dz));
        let report = decide(&turned, true, true, None);
        assert_eq!(report.found, None);
        assert!(report.detail.contains("counted towards the object"), "{}", report.detail);
    }
}
