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

use super::transform_models::{self, Match, Parameters, TransformModel};
use super::{lattice::Label, rail_fit::RailFit};
use crate::types::{calibration_options::ModelChoice, profile::HomographyModel, report::ModelCandidate};

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

/// All models, simplest first.
pub(super) const ALL: [StackModel; 4] = [
    StackModel::RailLinear,
    StackModel::PerSlice(TransformModel::Similarity),
    StackModel::PerSlice(TransformModel::Affine),
    StackModel::PerSlice(TransformModel::Homography),
];

/// A simpler model is kept up to this factor above the least expected squared error.
const TOLERANCE: f64 = 1.2;
/// RMS residual of the dots of one slice, px, beyond twice that under a homography, from which a model is not selected.
const MISSED: f64 = 0.2;
/// Residuals below this explain nothing, px.
const FLOOR: f64 = 0.01;

/// Error of a model at the image corners of one slice, with that of the full homography.
#[derive(Debug, Clone, Copy)]
pub(super) struct CornerError {
    /// Standard deviation of the worst corner by the scatter of the dots, px.
    pub sigma: f64,
    /// The same for the full homography, px.
    pub full_sigma: f64,
    /// Variance of the worst corner by what displaces all dots together, px^2. It does not tell models apart: both are
    /// displaced.
    pub doubt: f64,
    /// Largest distance between the corners of the two, px.
    pub apart: f64,
}

/// Mean squared bias of a model at the corners over the slices, px^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bias {
    /// The expected value.
    pub expected: f64,
    /// An upper value: at least what could be hidden in the scatter of so many slices, and at least half of the
    /// observed one, because all slices share the errors of the reference.
    pub upper: f64,
}

/// The bias of a model whose corners differ from those of the full homography by `corners`.
pub(super) fn bias(corners: &[CornerError]) -> Bias {
    if corners.is_empty() {
        return Bias { expected: 0.0, upper: 0.0 };
    }
    let count = corners.len() as f64;
    let mean = |of: &dyn Fn(&CornerError) -> f64| corners.iter().map(of).sum::<f64>() / count;
    let noise = mean(&|c| (c.full_sigma.powi(2) - c.sigma.powi(2)).max(0.0));
    // the largest of four distances scatters more than each
    let apart = mean(&|c| c.apart.powi(2));
    let expected = (apart - 1.7 * noise).max(0.0);
    Bias { expected, upper: (expected + noise * (2.0 / count).sqrt()).max(0.5 * apart) }
}

/// The selected model.
pub(super) struct Selection {
    /// The model.
    pub model: StackModel,
    /// What each model would give, simplest first.
    pub candidates: Vec<ModelCandidate>,
    /// Why the model was selected, as a sentence.
    pub reason: String,
}

/// Scores every model by its `corners` and selects one. `offsets`: rail positions relative to the reference slice;
/// `half`: px per unit; `requested`: the user's choice.
pub(super) fn select_model(
    evidence: &[&Evidence],
    offsets: &[f64],
    half: f64,
    corners: &dyn Fn(StackModel) -> Vec<CornerError>,
    requested: ModelChoice,
) -> Selection {
    let measured = (0..evidence.len()).filter(|&i| !evidence[i].matches.is_empty()).collect();
    let stack = StackDots { evidence, offsets, measured, half };
    let full_rms = stack.full_rms();
    let mut judged = ALL.map(|model| stack.judge(model, &full_rms));
    let best = least_risk(judged.iter().filter(|j| j.is_eligible).map(|j| j.model), corners);
    let wanted = match requested {
        ModelChoice::Auto => None,
        ModelChoice::RailLinear => Some(StackModel::RailLinear),
        ModelChoice::Similarity => Some(StackModel::PerSlice(TransformModel::Similarity)),
        ModelChoice::Affine => Some(StackModel::PerSlice(TransformModel::Affine)),
        ModelChoice::Homography => Some(StackModel::PerSlice(TransformModel::Homography)),
    };
    let model = wanted.or(best.map(|best| best.model)).unwrap_or(StackModel::PerSlice(TransformModel::Similarity));
    for judged in &mut judged {
        judged.candidate.chosen = judged.model == model;
    }
    let reason = reason(model, wanted.is_some(), best);
    Selection { model, candidates: judged.map(|judged| judged.candidate).into(), reason }
}

/// The model with the least expected squared error at the corners, or a simpler one whose error is nearly as small.
#[derive(Debug, Clone, Copy)]
struct Best {
    model: StackModel,
    /// False when a more complex model has a smaller error.
    is_least: bool,
}

/// The best of `models`, simplest first; `None` when none has corners.
fn least_risk(
    models: impl Iterator<Item = StackModel>,
    corners: &dyn Fn(StackModel) -> Vec<CornerError>,
) -> Option<Best> {
    let risk = |model: StackModel| {
        let corners = corners(model);
        let variance = corners.iter().map(|c| c.sigma.powi(2) + c.doubt).sum::<f64>() / corners.len().max(1) as f64;
        (!corners.is_empty()).then(|| (variance + bias(&corners).expected, model))
    };
    let risks: Vec<(f64, StackModel)> = models.filter_map(risk).collect();
    let least = risks.iter().map(|r| r.0).fold(f64::INFINITY, f64::min);
    // simplest first: it wins unless another is clearly better
    let (risk, model) = risks.into_iter().find(|r| r.0 <= TOLERANCE * least + FLOOR * FLOOR)?;
    Some(Best { model, is_least: risk <= least })
}

/// Why `model` was selected, as a sentence.
fn reason(model: StackModel, is_requested: bool, best: Option<Best>) -> String {
    match (is_requested, best) {
        (true, Some(best)) if best.model != model => {
            format!("{} was requested; the dots favour {}", phrase(model), phrase(best.model))
        }
        (true, _) => format!("{} was requested", phrase(model)),
        (false, None) => format!("the dots do not suffice to compare the models: {} is used", phrase(model)),
        (false, Some(Best { is_least: false, .. })) => format!(
            "{} is the simplest model whose expected error at the image corners is nearly the least",
            phrase(model)
        ),
        (false, Some(_)) => format!("{} has the least expected error at the image corners", phrase(model)),
    }
}

/// The dots of the stack.
struct StackDots<'a> {
    evidence: &'a [&'a Evidence],
    offsets: &'a [f64],
    /// The slices with dots.
    measured: Vec<usize>,
    /// Px per unit.
    half: f64,
}

/// What one model makes of the dots.
struct ModelFit {
    /// The transform of each measured slice; `None` when the dots do not determine them.
    transforms: Option<Vec<Parameters>>,
    /// Squared residuals of held-out dots, units^2.
    held_out: Option<Vec<f64>>,
    /// Number of free parameters.
    parameters: u32,
}

/// A model with its scores.
struct Judged {
    model: StackModel,
    candidate: ModelCandidate,
    /// False when the dots do not determine the model, or it misses the dots of a slice.
    is_eligible: bool,
}

impl StackDots<'_> {
    /// RMS residual of each measured slice under its own homography, px; `None` where its dots do not determine one.
    fn full_rms(&self) -> Vec<Option<f64>> {
        let rms = |&i: &usize| {
            let own = fitted(TransformModel::Homography, &self.evidence[i].matches)?;
            slice_rms(&own, self.evidence[i], self.half)
        };
        self.measured.iter().map(rms).collect()
    }

    fn judge(&self, model: StackModel, full_rms: &[Option<f64>]) -> Judged {
        let fit = match model {
            StackModel::RailLinear => self.fit_rail(),
            StackModel::PerSlice(model) => self.fit_per_slice(model),
        };
        let rms = |all: Vec<f64>| (all.iter().sum::<f64>() / all.len().max(1) as f64).sqrt() * self.half;
        let transforms = fit.transforms.as_ref();
        let bic = transforms.map(|transforms| self.bic(transforms, fit.parameters));
        let is_missed = transforms.is_some_and(|transforms| self.misses_a_slice(transforms, full_rms));
        let candidate = ModelCandidate {
            model: model.name(),
            parameters: fit.parameters,
            rms_px: transforms.map(|transforms| rms(self.residuals(transforms))),
            held_out_px: fit.held_out.map(rms),
            bic: bic.filter(|s| s.is_finite()),
            corner_sigma_px: None,
            chosen: false,
        };
        Judged { model, is_eligible: candidate.bic.is_some() && !is_missed, candidate }
    }

    /// The fit of a model with parameters of its own per slice.
    fn fit_per_slice(&self, model: TransformModel) -> ModelFit {
        let of = |i: usize| self.evidence[i];
        let transforms = self.measured.iter().map(|&i| fitted(model, &of(i).matches)).collect();
        let held_out = self.measured.iter().map(|&i| held_out(of(i), |m| fitted(model, m)));
        let held_out = held_out.collect::<Option<Vec<_>>>().map(|all| all.concat());
        ModelFit { transforms, held_out, parameters: (model.size() * self.measured.len()) as u32 }
    }

    /// The fit of the rail-linear model.
    fn fit_rail(&self) -> ModelFit {
        let transform = |fit: &RailFit, i: usize| fit.parameters(self.offsets[i]);
        let all: Vec<&[Match]> = self.evidence.iter().map(|e| &e.matches[..]).collect();
        let fit = RailFit::fit(&all, self.offsets);
        let transforms = fit.map(|fit| self.measured.iter().map(|&i| transform(&fit, i)).collect());
        let [even, odd] = [0, 1].map(|part| {
            let some: Vec<Vec<Match>> = self.evidence.iter().map(|e| block(e, part)).collect();
            RailFit::fit(&some, self.offsets)
        });
        let held_out = even.zip(odd).map(|(even, odd)| {
            let of_slice = |&i: &usize| -> Vec<f64> {
                squares(&transform(&even, i), &block(self.evidence[i], 1))
                    .chain(squares(&transform(&odd, i), &block(self.evidence[i], 0)))
                    .collect()
            };
            self.measured.iter().flat_map(of_slice).collect()
        });
        ModelFit { transforms, held_out, parameters: 3 }
    }

    /// Squared residuals of all dots, units^2.
    fn residuals(&self, transforms: &[Parameters]) -> Vec<f64> {
        let slices = self.measured.iter().zip(transforms);
        slices.flat_map(|(&i, p)| squares(p, &self.evidence[i].matches)).collect()
    }

    /// True when the residuals of a slice are much larger than under its own homography. A mean over all slices would
    /// hide one slice whose dots the model misses.
    fn misses_a_slice(&self, transforms: &[Parameters], full_rms: &[Option<f64>]) -> bool {
        self.measured.iter().zip(transforms).zip(full_rms).any(|((&i, p), own)| {
            let own = own.unwrap_or(0.0);
            slice_rms(p, self.evidence[i], self.half).is_some_and(|rms| rms * rms > 4.0 * own * own + MISSED * MISSED)
        })
    }

    /// BIC: the sum over the slices of `n ln(mean square)`, plus `k ln(n)` for k parameters.
    fn bic(&self, transforms: &[Parameters], parameters: u32) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (&i, p) in self.measured.iter().zip(transforms) {
            let e = self.evidence[i];
            let n = 2.0 * e.matches.len() as f64 / e.overlap.max(1.0);
            let squares = squares(p, &e.matches).sum::<f64>();
            let mean = self.half * self.half * squares / (2.0 * e.matches.len() as f64);
            sum += n * (mean + FLOOR * FLOOR).ln();
            count += n;
        }
        sum + f64::from(parameters) * count.max(1.0).ln()
    }
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
fn slice_rms(p: &Parameters, evidence: &Evidence, half: f64) -> Option<f64> {
    let count = evidence.matches.len();
    (count > 0).then(|| half * (squares(p, &evidence.matches).sum::<f64>() / count as f64).sqrt())
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
mod tests;
