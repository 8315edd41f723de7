//! The verdict: grade and accuracy in one sentence.

use crate::calibration::grade::{self, Finding};
use crate::calibration::{blur, findings::Facts, lost::Loss};
use crate::types::{Homography, pupils::PrincipalDistanceSource, report::Grade};

/// Largest advised blur radius over pitch (the pitch is 2.5 times the largest blur radius).
const ADVISED: f64 = 0.4;

/// The grade, and the verdict in one sentence. `pitch_mm`: pitch of the target as specified.
pub(super) fn verdict(facts: &Facts, findings: &[Finding], pitch_mm: Option<f64>) -> (Grade, String) {
    let (profile, reference) = (facts.profile, facts.solution.reference);
    let others = || profile.iter().filter(|s| s.index as usize != reference);
    let worst = others().filter_map(|s| s.corner_sigma_px).fold(0.0, f64::max);
    let rms = others().filter(|s| !s.interpolated).filter_map(|s| s.rms_px).fold(0.0, f64::max);
    let dots = profile.iter().filter(|s| !s.interpolated).filter_map(|s| s.inliers).min().unwrap_or(0);
    let (grade, limit) = grade::grade(worst, findings);
    let corners = match (grade, limit) {
        (Grade::Good, _) => format!("the image corners are good to {worst:.2} px"),
        (_, None) => format!("the image corners are uncertain by {worst:.2} px"),
        // the finding says what is wrong, and the corners are only as good as what it doubts
        (_, Some(finding)) => {
            format!("see {}; apart from that the image corners are good to {worst:.2} px", finding.warning.code)
        }
    };
    let predicted: Vec<usize> = profile.iter().filter(|s| s.interpolated).map(|s| s.index as usize).collect();
    let tail = if predicted.is_empty() {
        format!("all {} slices measured", profile.len())
    } else {
        let has_pitch = facts.tracked.detections[reference].as_ref().is_some_and(|s| s.pitch > 0.0);
        let why = too_fine(&predicted, &lost_to_blur(facts), pitch_mm).filter(|_| has_pitch).unwrap_or_default();
        format!("{} predicted{why}", slices_named(&predicted))
    };
    let same = others().all(|s| s.homography.corner_distance(&Homography::IDENTITY, 1000, 1000) < 1e-3);
    let still = if same { "; all slices have the same geometry" } else { "" };
    let text = format!(
        "{}: {corners}; dots fit to {rms:.3} px RMS or better, at least {dots} \
         dots per slice, {tail}{still}{}",
        grade::word(grade),
        camera(facts)
    );
    (grade, text)
}

/// What is known of the principal distance; empty when the user specified nothing about the camera.
fn camera(facts: &Facts) -> String {
    let camera = facts.camera;
    let sigma = camera.pupils.principal_distance_sigma_mm.unwrap_or_default();
    let known = match (camera.principal_distance_mm, camera.source) {
        (Some(distance), PrincipalDistanceSource::FocalLength) => {
            format!("; principal distance roughly {distance:.0} +- {sigma:.0} mm, by focal_mm alone")
        }
        (Some(distance), PrincipalDistanceSource::PupilRatio) => {
            format!("; principal distance {distance:.1} +- {sigma:.1} mm, by pupil_ratio as specified")
        }
        (Some(distance), _) => format!("; principal distance {distance:.2} +- {sigma:.2} mm"),
        (None, _) if camera.pixel_pitch_mm.is_some() => "; principal distance not known".to_owned(),
        (None, _) => String::new(),
    };
    let doubts = facts.contradictions.iter().map(|found| format!("; see {}", found.code));
    known + &doubts.collect::<String>()
}

/// Per slice that was lost to blur its blur radius, grid steps: at least that at which the pattern vanishes.
fn lost_to_blur(facts: &Facts) -> Vec<Option<f64>> {
    let radius = |i: usize| {
        let is_lost = facts.profile[i].interpolated && Loss::of(facts.tracked, i) == Loss::Blurred;
        is_lost.then(|| facts.blurs[i].unwrap_or(blur::VANISHES))
    };
    (0..facts.blurs.len()).map(radius).collect()
}

/// That the pitch of the target is too fine for the `predicted` slices, in brackets; `None` when blur is not the reason
/// for any of them. `lost_to_blur`: the blur radii, in grid steps, of the slices of which it is.
fn too_fine(predicted: &[usize], lost_to_blur: &[Option<f64>], pitch_mm: Option<f64>) -> Option<String> {
    let blurred: Vec<usize> = predicted.iter().copied().filter(|&i| lost_to_blur[i].is_some()).collect();
    let blur = lost_to_blur.iter().flatten().copied().fold(0.0, f64::max);
    if blur <= ADVISED {
        return None;
    }
    let which = match blurred.len() {
        1 if predicted.len() == 1 => "its blur".to_owned(),
        n if n == predicted.len() => "their blur".to_owned(),
        _ => format!("the blur of {}", slices_named(&blurred)),
    };
    let advice = match pitch_mm {
        Some(mm) => format!("{:.2} mm or more", mm * blur / ADVISED),
        None => format!("{:.1} times the pitch or more", blur / ADVISED),
    };
    Some(format!(" (the target's pitch is too fine for {which}: use {advice})"))
}

/// Slices by their indices, as a phrase.
fn slices_named(indices: &[usize]) -> String {
    let noun = if indices.len() == 1 { "slice" } else { "slices" };
    format!("{noun} {}", ranges(indices))
}

/// Indices as ranges: `0 to 2, 7`.
fn ranges(indices: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &i in indices {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == i => *last = i,
            _ => parts.push((i, i)),
        }
    }
    let text = |(a, b): &(usize, usize)| if a == b { a.to_string() } else { format!("{a} to {b}") };
    parts.iter().map(text).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_written_as_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 7, 9, 10]), "0 to 2, 7, 9 to 10");
        assert_eq!(ranges(&[]), "");
    }
}
