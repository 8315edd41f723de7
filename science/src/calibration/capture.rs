//! The capture mode: whether the sensor moved alone (fixed lens), camera and lens together (moving lens), or the lens
//! alone.
//!
//! Two criteria:
//!
//! - Law: the bend of the sizes over the rail ([`SizeLaw`]) is 0 with a fixed lens, 1 with a moving lens, and between
//!   them with a lens that moves alone. A mode is found if it is likelier than all others together by 20 to 1.
//! - Direction: towards the object, the image shrinks with a fixed lens (the sensor approaches the lens) and grows with
//!   the others.

use super::size_law::{ScaleSample, SizeLaw};
use super::statistics::{median_of, range};
use crate::types::lens::PLAUSIBLE_PUPIL_RATIOS;
use crate::types::{profile::CaptureMode, report::CaptureReport};

/// The modes with their probability before any measurement: few rails move a lens alone.
const MODES: [(CaptureMode, f64); 3] =
    [(CaptureMode::FixedLens, 1.0), (CaptureMode::MovingLens, 1.0), (CaptureMode::LensAlone, 0.2)];
/// Share of the probability from which a mode counts as found.
const CERTAIN: f64 = 0.95;
/// Least standard deviation of the bend: rails are not perfect.
const LEAST_BEND_SIGMA: f64 = 0.01;
/// Change of the size over the stack, in standard deviations, from which its direction counts.
const NOTICEABLE: f64 = 10.0;

/// Decides the capture mode from the sizes. `in_mm`: positions came from the user, so the direction criterion applies.
/// `even`: steps are known to be equal, so the law criterion applies. `given`: the mode that the user specified.
pub(super) fn decide(
    slices: &[ScaleSample],
    in_mm: bool,
    even: bool,
    given: Option<CaptureMode>,
    magnification: Option<f64>,
) -> CaptureReport {
    let growth = growth(slices);
    let law = SizeLaw::fit(slices, None).filter(|law| {
        // a bend that is that of no mode shows a rail whose steps are wrong
        let margin = 4.0 * law.bend_sigma.max(LEAST_BEND_SIGMA);
        even && slices.len() >= 5 && growth.is_some() && (-margin..=1.0 + margin).contains(&law.bend)
    });
    let by_law = law.map(|law| likelihoods(&law, magnification));
    concluded(growth.filter(|_| in_mm), by_law, given, &LAW)
}

/// Decides the capture mode without the law, as the steps of the rail are not known to be even: from the direction of
/// the sizes, and from `likelihoods` of a fixed lens, a moving lens and a lens that moves alone. The rest is as for
/// [`decide`].
pub(super) fn decide_by(
    slices: &[ScaleSample],
    in_mm: bool,
    given: Option<CaptureMode>,
    likelihoods: Option<[f64; 3]>,
) -> CaptureReport {
    let weighted = likelihoods.map(|by| [0, 1, 2].map(|n| MODES[n].1 * by[n]));
    let mut report = concluded(growth(slices).filter(|_| in_mm), weighted, given, &PICTURES);
    if let (Some(weighted), Some(found)) = (weighted, report.found) {
        let of_found = (0..3).find(|&n| MODES[n].0 == found).map_or(0.0, |n| weighted[n]);
        // the model of the evidence is not more certain than this
        let confidence = (of_found / weighted.iter().sum::<f64>()).min(0.99);
        report.confidence = Some(confidence);
        report.detail = format!("{} (probability {:.0} %)", report.detail, 100.0 * confidence);
    }
    report
}

/// How the evidence is called in sentences.
struct Words {
    follows: &'static str,
    disagrees: &'static str,
    silent: &'static str,
}

const LAW: Words = Words {
    follows: "the sizes follow the law of",
    disagrees: "the law of the sizes",
    silent: "the sizes do not show what moved: too few slices, too small a change of size, or uneven steps",
};
const PICTURES: Words = Words {
    follows: "brightness and parallax of the slices are those of",
    disagrees: "the brightness and parallax of the slices",
    silent: "the slices do not show what moved: neither their brightness nor the parallax of near and far parts decides it",
};

/// The conclusion from the growth of the image towards the object, if it is known, and from probabilities.
fn concluded(growth: Option<f64>, by: Option<[f64; 3]>, given: Option<CaptureMode>, words: &Words) -> CaptureReport {
    let probable = by.unwrap_or(MODES.map(|(_, prior)| prior));
    let by_direction = growth.map(|growth| MODES.map(|(mode, _)| (growth < 0.0) == (mode == CaptureMode::FixedLens)));
    let both = [0, 1, 2].map(|n| if by_direction.is_none_or(|fits| fits[n]) { probable[n] } else { 0.0 });
    let is_contradictory = certain(&probable).is_some_and(|n| both[n] == 0.0);
    let found = certain(&both).filter(|_| !is_contradictory).map(|n| MODES[n].0);
    let detail = match found {
        _ if is_contradictory => format!(
            "{} and the direction of the rail disagree: check that rail positions are counted towards the object",
            words.disagrees
        ),
        Some(mode) if by.is_some() => format!("{} {}", words.follows, name(mode)),
        Some(mode) => format!("towards the object the image shrinks, as with {}", name(mode)),
        None if by_direction.is_some_and(|fits| !fits[0]) => format!(
            "the image grows towards the object, as with {} and with {}; the range of the rail is too small to tell them \
             apart: specify capture_mode",
            name(CaptureMode::MovingLens),
            name(CaptureMode::LensAlone)
        ),
        None => format!("{}: specify capture_mode", words.silent),
    };
    CaptureReport { told: given, found, confidence: None, detail }
}

/// The mode as a phrase for sentences.
pub(super) fn name(mode: CaptureMode) -> &'static str {
    match mode {
        CaptureMode::FixedLens => "a fixed lens (only the sensor moves)",
        CaptureMode::MovingLens => "a moving lens (camera and lens move together)",
        CaptureMode::LensAlone => "a lens that moves alone (the camera body is fixed)",
    }
}

/// That the slices show another mode than the user specified, as a sentence.
pub(super) fn disagreement(given: CaptureMode, found: CaptureMode) -> String {
    format!(
        "capture_mode specifies {}, but the slices show {}: correct the option, or check what the rail moves",
        name(given),
        name(found)
    )
}

/// Index of the mode that is likelier than the others together by far.
fn certain(probabilities: &[f64; 3]) -> Option<usize> {
    let sum: f64 = probabilities.iter().sum();
    (0..3).find(|&n| probabilities[n] > CERTAIN * sum && sum > 0.0)
}

/// Likelihood of each mode by the bend, times its prior. The bend of a lens that moves alone is `M P / (1 + M P)`, with
/// any plausible pupil ratio.
fn likelihoods(law: &SizeLaw, magnification: Option<f64>) -> [f64; 3] {
    let sigma = law.bend_sigma.max(LEAST_BEND_SIGMA);
    let of_alone = |ratio: f64| magnification.map(|m| m * ratio / (1.0 + m * ratio));
    let [low, high] = PLAUSIBLE_PUPIL_RATIOS;
    let (low, high) = (of_alone(low).unwrap_or(0.1), of_alone(high).unwrap_or(0.9));
    let normal = |expected: f64| (-0.5 * ((law.bend - expected) / sigma).powi(2)).exp();
    // the normal density, averaged over the range of the bend
    const STEPS: usize = 200;
    let mean =
        (0..STEPS).map(|k| normal(low + (high - low) * (k as f64 + 0.5) / STEPS as f64)).sum::<f64>() / STEPS as f64;
    MODES.map(|(mode, prior)| {
        prior
            * match mode {
                CaptureMode::FixedLens => normal(0.0),
                CaptureMode::MovingLens => normal(1.0),
                CaptureMode::LensAlone => mean,
            }
    })
}

/// Growth of the image per unit of the position, if it is noticeable over the stack.
fn growth(slices: &[ScaleSample]) -> Option<f64> {
    let (low, high) = range(slices.iter().map(|s| s.position));
    let noise = median_of(slices.iter().map(|s| s.sigma));
    let law = SizeLaw::fit(slices, Some(CaptureMode::FixedLens))?;
    ((law.growth * (high - low)).abs() > NOTICEABLE * noise.max(0.3 * law.growth_sigma * (high - low)))
        .then_some(law.growth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::lens::Lens;

    fn stack(size: impl Fn(f64) -> f64) -> Vec<ScaleSample> {
        (-4..=4)
            .map(f64::from)
            .map(|z| ScaleSample { position: z, size: size(z), sigma: 3e-6 + 2e-8 * z.abs() })
            .collect()
    }

    #[test]
    fn the_law_of_the_sizes_decides_the_capture_mode_only_when_it_is_unambiguous() {
        let fixed = stack(|dz| 1.0 - dz / 47.0);
        assert_eq!(decide(&fixed, false, true, None, None).found, Some(CaptureMode::FixedLens));
        let moving = stack(|dz| 1.0 / (1.0 - dz / 47.0));
        assert_eq!(decide(&moving, false, true, None, None).found, Some(CaptureMode::MovingLens));
        assert_eq!(decide(&stack(|dz| 1.0 - dz / 1e7), false, true, None, None).found, None);
        assert_eq!(decide(&stack(|dz| 1.0 + 0.01 * (dz * 2.0).sin()), false, true, None, None).found, None);
        assert_eq!(decide(&fixed, false, false, None, None).found, None);
    }

    #[test]
    fn a_lens_that_moves_alone_is_found_by_its_bend_or_undecided() {
        for (magnification, pupil_ratio) in [(0.5, 0.6), (1.0, 1.0), (2.5, 1.8)] {
            let lens = Lens { focal_mm: 65.0, magnification, pupil_ratio };
            for (reach, found) in [(0.6, Some(CaptureMode::LensAlone)), (0.01, None)] {
                let samples = stack(|z| lens.size(CaptureMode::LensAlone, reach * z));
                let report = decide(&samples, true, true, None, Some(magnification));
                assert_eq!(report.found, found, "{lens:?}, {reach}: {}", report.detail);
                assert!(found.is_some() || report.detail.contains("specify capture_mode"), "{}", report.detail);
            }
        }
    }

    #[test]
    fn the_direction_of_the_rail_decides_too_and_a_contradiction_is_reported() {
        let fixed = stack(|dz| 1.0 - 3.0 * dz / 141.0);
        assert_eq!(decide(&fixed, true, false, None, None).found, Some(CaptureMode::FixedLens));
        let moving = stack(|dz| 1.0 / (1.0 - dz / 47.0));
        let undecided = decide(&moving, true, false, None, None);
        assert!(undecided.found.is_none() && undecided.detail.contains("specify capture_mode"), "{}", undecided.detail);
        let turned = stack(|dz| 1.0 + 3.0 * dz / 141.0);
        let report = decide(&turned, true, true, None, None);
        assert_eq!(report.found, None);
        assert!(report.detail.contains("counted towards the object"), "{}", report.detail);
    }
}
