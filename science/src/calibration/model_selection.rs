//! Selects the transform model of a stack: the simplest with a nearly minimal expected error at the image corners.
//!
//! The image corners matter, and they often lie outside the dots. Each model m is scored by its expected squared error
//! there (a focused information criterion, Claeskens and Hjort 2003):
//!
//! `risk(m) = variance(m) + bias(m)^2`
//!
//! The variance is that of its free parameters. The bias is the distance of its corners from those of the full
//! homography, minus what the scatter of the full homography explains. Goodness of fit alone does not detect a
//! perspective that is hidden within the dots of a small target and amounts to 0.2 px at the corner.
//!
//! Two criteria are reported beside it: the Bayesian information criterion (dots with overlapping windows count in
//! part; residuals below 0.01 px count as 0.01 px), and the residual of held-out dots in blocks of 3 x 3 (neighbours
//! share pixels, so single dots would not be independent).

use super::lattice::Label;
use super::rail_fit::RailFit;
use super::transform_models::{self, Match, Parameters, TransformModel};
use crate::types::calibration_options::ModelChoice;
use crate::types::profile::HomographyModel;
use crate::types::report::ModelCandidate;

/// The inliers of one slice.
#[derive(Debug, Clone, Default)]
pub(super) struct Evidence {
    /// Their labels.
    pub labels: Vec<Label>,
    /// Their positions in the reference slice and in this slice.
    pub matches: Vec<Match>,
    /// Variance of their mean over the variance for as many independent dots.
    pub overlap: f64,
}

/// A transform model for the whole stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StackModel {
    /// Three parameters for all slices.
    RailLinear,
    /// Parameters of its own per slice.
    PerSlice(TransformModel),
}

impl StackModel {
    /// The model as named in a profile.
    pub(super) fn name(self) -> HomographyModel {
        match self {
            Self::RailLinear => HomographyModel::RailLinear,
            Self::PerSlice(model) => model.homography_model(),
        }
    }
}

/// A simpler model is kept up to this factor above the least expected squared error.
const TOLERANCE: f64 = 1.2;
/// RMS residual of the dots of one slice, px, beyond twice that under a homography, from which a model is not selected.
const MISSED: f64 = 0.2;
/// Residuals below this explain nothing, px.
const FLOOR: f64 = 0.01;

/// Error of a model at the image corners of one slice, with that of the full homography.
#[derive(Debug, Clone, Copy)]
pub(super) struct CornerError {
    /// Standard deviation of the worst corner, px.
    pub sigma: f64,
    /// The same for the full homography, px.
    pub full_sigma: f64,
    /// Largest distance between the corners of the two, px.
    pub apart: f64,
}

/// Mean squared bias of a model at the corners over the slices, px^2: the expected value, and an upper value. The upper
/// one is at least what could be hidden in the scatter of so many slices, and at least half of the observed one,
/// because all slices share the errors of the reference.
pub(super) fn bias(corners: &[CornerError]) -> (f64, f64) {
    if corners.is_empty() {
        return (0.0, 0.0);
    }
    let count = corners.len() as f64;
    let mean = |of: &dyn Fn(&CornerError) -> f64| corners.iter().map(of).sum::<f64>() / count;
    let noise = mean(&|c| (c.full_sigma.powi(2) - c.sigma.powi(2)).max(0.0));
    // the largest of four distances scatters more than each
    let apart = mean(&|c| c.apart.powi(2));
    let observed = (apart - 1.7 * noise).max(0.0);
    (observed, (observed + noise * (2.0 / count).sqrt()).max(0.5 * apart))
}

/// Scores every model by its `corners` and selects one. `offsets`: rail positions relative to the reference slice;
/// `half`: px per unit; `requested`: the user's choice.
pub(super) fn select_model(
    evidence: &[Evidence],
    offsets: &[f64],
    half: f64,
    corners: &dyn Fn(StackModel) -> Vec<CornerError>,
    requested: ModelChoice,
) -> (StackModel, Vec<ModelCandidate>, String) {
    let measured: Vec<usize> = (0..evidence.len()).filter(|&i| !evidence[i].matches.is_empty()).collect();
    let per_slice = |model: TransformModel| {
        let maps = measured.iter().map(|&i| fitted(model, &evidence[i].matches)).collect::<Option<Vec<_>>>();
        let held = measured.iter().map(|&i| held_out(&evidence[i], |m| fitted(model, m))).collect::<Option<Vec<_>>>();
        (maps, held, (model.size() * measured.len()) as u32)
    };
    let rail_fit = || {
        let all: Vec<Vec<Match>> = evidence.iter().map(|e| e.matches.clone()).collect();
        let maps =
            RailFit::fit(&all, offsets).map(|j| measured.iter().map(|&i| j.parameters(offsets[i])).collect::<Vec<_>>());
        let halves = [0, 1].map(|part| {
            let some: Vec<Vec<Match>> = evidence.iter().map(|e| block(e, part)).collect();
            RailFit::fit(&some, offsets)
        });
        let held = match halves {
            [Some(even), Some(odd)] => Some(
                measured
                    .iter()
                    .map(|&i| {
                        squares(&even.parameters(offsets[i]), &block(&evidence[i], 1))
                            .chain(squares(&odd.parameters(offsets[i]), &block(&evidence[i], 0)))
                            .collect()
                    })
                    .collect::<Vec<_>>(),
            ),
            _ => None,
        };
        (maps, held, 3)
    };
    let models = [StackModel::RailLinear].into_iter().chain(transform_models::ALL.map(StackModel::PerSlice));
    let full: Vec<Option<f64>> = measured
        .iter()
        .map(|&i| {
            let own = fitted(TransformModel::Homography, &evidence[i].matches)?;
            slice_rms(own, &evidence[i], half)
        })
        .collect();
    let mut missed: Vec<StackModel> = Vec::new();
    let mut judged: Vec<(StackModel, ModelCandidate)> = models
        .map(|model| {
            let (maps, held, parameters) = match model {
                StackModel::RailLinear => rail_fit(),
                StackModel::PerSlice(model) => per_slice(model),
            };
            let rms = |all: Vec<f64>| (all.iter().sum::<f64>() / all.len().max(1) as f64).sqrt() * half;
            let score = maps.as_ref().map(|maps| score(evidence, &measured, maps, parameters, half));
            // a mean over all slices would hide one slice whose dots the model misses
            let misses = |(k, p): (usize, &Parameters)| {
                let own = full[k].unwrap_or(0.0);
                slice_rms(*p, &evidence[measured[k]], half)
                    .is_some_and(|rms| rms * rms > 4.0 * own * own + MISSED * MISSED)
            };
            if maps.as_ref().is_some_and(|maps| maps.iter().enumerate().any(misses)) {
                missed.push(model);
            }
            let rms_px = maps.map(|maps| {
                rms(measured
                    .iter()
                    .zip(&maps)
                    .flat_map(|(&i, p)| squares(p, &evidence[i].matches).collect::<Vec<_>>())
                    .collect())
            });
            let candidate = ModelCandidate {
                model: model.name(),
                parameters,
                rms_px,
                held_out_px: held.map(|held| rms(held.concat())),
                bic: score.filter(|s| s.is_finite()),
                corner_sigma_px: None,
                chosen: false,
            };
            (model, candidate)
        })
        .collect();
    let wanted = match requested {
        ModelChoice::Auto => None,
        ModelChoice::RailLinear => Some(StackModel::RailLinear),
        ModelChoice::Similarity => Some(StackModel::PerSlice(TransformModel::Similarity)),
        ModelChoice::Affine => Some(StackModel::PerSlice(TransformModel::Affine)),
        ModelChoice::Homography => Some(StackModel::PerSlice(TransformModel::Homography)),
    };
    let risk = |model: StackModel| {
        let corners = corners(model);
        let variance = corners.iter().map(|c| c.sigma.powi(2)).sum::<f64>() / corners.len().max(1) as f64;
        (!corners.is_empty()).then(|| variance + bias(&corners).0)
    };
    let fitted = judged.iter().filter(|(model, c)| c.bic.is_some() && !missed.contains(model));
    let risks: Vec<(f64, StackModel)> = fitted.filter_map(|(model, _)| risk(*model).map(|r| (r, *model))).collect();
    let least = risks.iter().map(|r| r.0).fold(f64::INFINITY, f64::min);
    // simplest first: it wins unless another is clearly better
    let simplest = risks.iter().find(|r| r.0 <= TOLERANCE * least + FLOOR * FLOOR);
    let best = simplest.map(|r| r.1);
    let model = wanted.or(best).unwrap_or(StackModel::PerSlice(TransformModel::Similarity));
    let reason = match (wanted, best) {
        (Some(_), Some(best)) if best != model => {
            format!("{} was requested; the dots favour {}", phrase(model), phrase(best))
        }
        (Some(_), _) => format!("{} was requested", phrase(model)),
        (None, None) => format!("the dots do not suffice to compare the models: {} is used", phrase(model)),
        (None, Some(_)) if simplest.is_some_and(|r| r.0 > least) => format!(
            "{} is the simplest model whose expected error at the image corners is nearly the least",
            phrase(model)
        ),
        (None, Some(_)) => format!("{} has the least expected error at the image corners", phrase(model)),
    };
    for (candidate, judged) in &mut judged {
        judged.chosen = *candidate == model;
    }
    (model, judged.into_iter().map(|j| j.1).collect(), reason)
}

/// The model as a phrase for sentences.
fn phrase(model: StackModel) -> &'static str {
    match model {
        StackModel::RailLinear => "the rail law for the whole stack",
        StackModel::PerSlice(TransformModel::Similarity) => "scale, rotation and shift per slice",
        StackModel::PerSlice(TransformModel::Affine) => "an affine transform per slice",
        StackModel::PerSlice(TransformModel::Homography) => "a homography per slice",
    }
}

fn fitted(model: TransformModel, matches: &[Match]) -> Option<Parameters> {
    transform_models::fit(model, matches).map(|fit| model.parameters(&fit.free))
}

/// Squared residuals, units^2.
fn squares<'a>(p: &'a Parameters, matches: &'a [Match]) -> impl Iterator<Item = f64> + 'a {
    matches.iter().map(|m| {
        let sent = transform_models::map_point(p, m.base);
        (m.here[0] - sent[0]).powi(2) + (m.here[1] - sent[1]).powi(2)
    })
}

/// RMS residual of the dots of one slice, px; `None` without dots.
fn slice_rms(p: Parameters, evidence: &Evidence, half: f64) -> Option<f64> {
    let count = evidence.matches.len();
    (count > 0).then(|| half * (squares(&p, &evidence.matches).sum::<f64>() / count as f64).sqrt())
}

/// BIC: the sum over the slices of `n ln(mean square)`, plus `k ln(n)` for k parameters.
fn score(evidence: &[Evidence], measured: &[usize], maps: &[Parameters], parameters: u32, half: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (&i, p) in measured.iter().zip(maps) {
        let e = &evidence[i];
        let n = 2.0 * e.matches.len() as f64 / e.overlap.max(1.0);
        let mean = half * half * squares(p, &e.matches).sum::<f64>() / (2.0 * e.matches.len() as f64);
        sum += n * (mean + FLOOR * FLOOR).ln();
        count += n;
    }
    sum + f64::from(parameters) * count.max(1.0).ln()
}

/// The dots of every other block of 3 x 3.
fn block(evidence: &Evidence, part: i32) -> Vec<Match> {
    let of = |[i, j]: Label| (i.div_euclid(3) + j.div_euclid(3)).rem_euclid(2);
    evidence.labels.iter().zip(&evidence.matches).filter(|(l, _)| of(**l) == part).map(|(_, m)| *m).collect()
}

/// Squared residuals of each half of the dots from the fit to the other half.
fn held_out(evidence: &Evidence, fit: impl Fn(&[Match]) -> Option<Parameters>) -> Option<Vec<f64>> {
    let [even, odd] = [block(evidence, 0), block(evidence, 1)];
    let (from_even, from_odd) = (fit(&even)?, fit(&odd)?);
    Some(squares(&from_even, &odd).chain(squares(&from_odd, &even)).collect())
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    /// Nine slices of 150 dots whose transforms are `map(dz)`.
    fn stack(map: impl Fn(f64) -> Parameters, seed: u64) -> (Vec<Evidence>, Vec<f64>) {
        let mut noise = Noise(seed);
        let offsets: Vec<f64> = (-4..=4).map(f64::from).collect();
        let evidence = offsets
            .iter()
            .map(|dz| {
                let labels: Vec<Label> = (0..150).map(|k| [k % 15, k / 15]).collect();
                let matches = labels.iter().map(|l| {
                    let base = [f64::from(l[0]) / 9.0 - 0.78, f64::from(l[1]) / 9.0 - 0.5];
                    let here = transform_models::map_point(&map(*dz), base).map(|v| v + 5e-5 * noise.normal());
                    Match { base, here, sigma: 5e-5 }
                });
                let matches = if *dz == 0.0 { Vec::new() } else { matches.collect() };
                Evidence { labels, matches, overlap: 2.25 }
            })
            .collect();
        (evidence, offsets)
    }

    /// Corner errors from the fits of the models.
    fn corners(evidence: &[Evidence], offsets: &[f64], model: StackModel) -> Vec<CornerError> {
        let frame = transform_models::Frame { centre: [400.0, 300.0], half: 500.0 };
        let all: Vec<Vec<Match>> = evidence.iter().map(|e| e.matches.clone()).collect();
        let rail_fit = RailFit::fit(&all, offsets).expect("a law");
        let at = |model: TransformModel, e: &Evidence| {
            let fit = transform_models::fit(model, &e.matches).expect("a fit");
            let sigma = transform_models::corner_sigma(model, &fit.free, &fit.covariance, &frame, 801, 601);
            (frame.homography(&model.parameters(&fit.free)).expect("regular"), sigma)
        };
        let measured = (0..offsets.len()).filter(|&i| !evidence[i].matches.is_empty());
        measured
            .map(|i| {
                let (full, full_sigma) = at(TransformModel::Homography, &evidence[i]);
                let (own, sigma) = match model {
                    StackModel::PerSlice(model) => at(model, &evidence[i]),
                    StackModel::RailLinear => (
                        frame.homography(&rail_fit.parameters(offsets[i])).expect("regular"),
                        500.0 * rail_fit.corner_sigma(offsets[i]),
                    ),
                };
                CornerError { sigma, full_sigma, apart: own.corner_distance(&full, 801, 601) }
            })
            .collect()
    }

    fn chosen(map: impl Fn(f64) -> Parameters) -> HomographyModel {
        let (evidence, offsets) = stack(map, 3);
        let (model, candidates, _) =
            select_model(&evidence, &offsets, 500.0, &|m| corners(&evidence, &offsets, m), ModelChoice::Auto);
        assert_eq!(candidates.iter().filter(|c| c.chosen).count(), 1);
        assert!(candidates.iter().all(|c| c.held_out_px.is_some() && c.bic.is_some()));
        model.name()
    }

    #[test]
    fn the_model_with_the_least_corner_error_is_selected() {
        assert_eq!(chosen(|z| [0.007 * z, 0.0, 0.001 * z, 0.0, 0.007 * z, 0.0, 0.0, 0.0]), HomographyModel::RailLinear);
        let turning = |z: f64| [0.007 * z, -3e-4 * z * z, 0.001 * z, 3e-4 * z * z, 0.007 * z, 0.0, 0.0, 0.0];
        assert_eq!(chosen(turning), HomographyModel::Similarity);
        assert_eq!(chosen(|z| [0.007 * z, 1e-3 * z, 0.0, 0.0, 0.008 * z, 0.0, 0.0, 0.0]), HomographyModel::Affine);
        assert_eq!(
            chosen(|z| [0.007 * z, 0.0, 0.0, 0.0, 0.007 * z, 0.0, 8e-4 * z, -5e-4 * z]),
            HomographyModel::Homography
        );
    }

    #[test]
    fn a_requested_model_is_used_and_the_better_one_is_named() {
        let (evidence, offsets) = stack(|z| [0.007 * z, 0.0, 0.0, 0.0, 0.007 * z, 0.0, 8e-4 * z, 0.0], 4);
        let (model, _, reason) =
            select_model(&evidence, &offsets, 500.0, &|m| corners(&evidence, &offsets, m), ModelChoice::Similarity);
        assert_eq!(model.name(), HomographyModel::Similarity);
        assert!(reason.contains("the dots favour a homography"), "{reason}");
    }
}
