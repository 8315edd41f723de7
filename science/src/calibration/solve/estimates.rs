//! The transform of each slice under one model, from its dots and the rail law, with its uncertainty.

use nalgebra::DVector;

use super::inliers::{FLOOR, Inliers, own_estimates};
use super::rail_state::{RailState, in_line};
use crate::calibration::model_selection::{CornerError, StackModel};
use crate::calibration::rail::{self, EstimateSource, OwnEstimate};
use crate::calibration::transform_models::{self, Frame, Match, Parameters, TransformModel};
use crate::calibration::{detected::Detection, rail_fit::RailFit, tracked::Tracked};
use crate::types::Homography;

/// Uncertainty of the image corners, px, from which a slice counts as predicted when the rail law halves it.
const MAX_OWN_SIGMA: f64 = 0.4;

/// Common input of all estimates.
pub(super) struct Setting<'a> {
    /// Conversion between units and pixels.
    pub(super) frame: Frame,
    /// Width and height of the slices, px.
    pub(super) size: [u32; 2],
    /// Index of the reference slice.
    pub(super) reference: usize,
    /// The rail.
    pub(super) rail: &'a RailState,
    /// Uncertainty per slice that no number of dots reduces, px (see [`floors`]).
    pub(super) floors: Vec<f64>,
    /// Per slice: true when the model of the stack and the rail law do not apply to it, because its dots differ.
    pub(super) alone: Vec<bool>,
}

impl<'a> Setting<'a> {
    /// For slices of `size` = width, height.
    pub(super) fn new(frame: Frame, size: [u32; 2], reference: usize, rail: &'a RailState, floors: Vec<f64>) -> Self {
        Self { frame, size, reference, rail, floors, alone: vec![false; rail.positions.len()] }
    }

    /// Largest distance between the image corners under two homographies, px.
    pub(super) fn apart(&self, a: &Homography, b: &Homography) -> f64 {
        a.corner_distance(b, self.size[0], self.size[1])
    }

    /// Standard deviation of the worst image corner under an estimate of the parameters of `model`, px.
    pub(super) fn corner_sigma(&self, model: TransformModel, own: &OwnEstimate) -> f64 {
        transform_models::corner_sigma(model, &own.free, &own.covariance, &self.frame, self.size[0], self.size[1])
    }
}

/// The estimate of one slice.
#[derive(Debug, Clone, Copy)]
pub(in crate::calibration) struct Estimate {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// The homography by the rail law alone.
    pub by_law: Option<Homography>,
    /// Largest corner distance between the slice's own estimate and the rail law, px.
    pub off_law: Option<f64>,
    /// Standard deviation of the worst image corner, px.
    pub sigma: f64,
    /// What the estimate is based on.
    pub source: EstimateSource,
}

impl Estimate {
    /// The reference slice.
    pub(super) const IDENTITY: Self = Self {
        homography: Homography::IDENTITY,
        by_law: None,
        off_law: None,
        sigma: 0.0,
        source: EstimateSource::Dots,
    };
}

/// Errors at the image corners under a model and under the full homography, for the measured slices. `told`: the
/// estimates under the model with the doubts of the dots; the others are without.
pub(super) fn corner_errors(
    told: &[Option<Estimate>],
    estimates: &[Option<Estimate>],
    full: &[Option<Estimate>],
    inliers: &[Inliers],
    s: &Setting,
) -> Vec<CornerError> {
    let counts = |i: usize| i != s.reference && !s.alone[i] && !inliers[i].evidence.matches.is_empty();
    let measured = (0..estimates.len()).filter(|&i| counts(i));
    measured
        .filter_map(|i| Some((told.get(i)?.as_ref()?, estimates[i].as_ref()?, full.get(i)?.as_ref()?)))
        .map(|(told, own, full)| CornerError {
            sigma: own.sigma,
            full_sigma: full.sigma,
            doubt: (told.sigma.powi(2) - own.sigma.powi(2)).max(0.0),
            apart: s.apart(&own.homography, &full.homography),
        })
        .collect()
}

/// The estimates of all slices under a model; `None` where there is neither a measurement nor a rail law.
pub(super) fn estimates(model: StackModel, inliers: &[Inliers], setting: &Setting) -> Vec<Option<Estimate>> {
    match model {
        StackModel::RailLinear => rail_linear_estimates(inliers, setting),
        StackModel::PerSlice(model) => per_slice_estimates(model, inliers, setting),
    }
}

/// Uncertainty per slice, px, that no number of dots reduces. It grows as blur attenuates the pattern.
pub(super) fn floors(tracked: &Tracked, pitch: f64) -> Vec<f64> {
    let strongest = tracked.strongest();
    let left = |s: &Detection| (s.modulation / strongest).abs().clamp(0.05, 1.0);
    let floor = |s: &Option<Detection>| {
        let blurred = s.as_ref().map_or(1.0, |s| 0.5 + 0.5 / left(s));
        (FLOOR.0 + FLOOR.1 * pitch) * blurred
    };
    tracked.detections.iter().map(floor).collect()
}

/// The homography of each slice by the rail law of the others but those of `out`; `None` without a law.
pub(super) fn predicted_without(out: &[usize], inliers: &[Inliers], s: &Setting) -> Vec<Option<Homography>> {
    let RailState { coordinates, jump, displaced, .. } = s.rail;
    let model = TransformModel::Homography;
    let own = own_estimates(model, inliers, s.reference, &s.frame, s.size);
    let displaced: Vec<bool> = displaced.iter().enumerate().map(|(i, off)| *off || out.contains(&i)).collect();
    let in_line = in_line(&own, &displaced);
    let predict = |i: usize| {
        let expected = rail::predicted(&in_line, coordinates, *jump, i)?;
        s.frame.homography(&model.parameters(&expected.free))
    };
    (0..own.len()).map(predict).collect()
}

fn per_slice_estimates(model: TransformModel, inliers: &[Inliers], s: &Setting) -> Vec<Option<Estimate>> {
    let RailState { coordinates, jump, displaced, .. } = s.rail;
    let displaced: Vec<bool> = displaced.iter().zip(&s.alone).map(|(a, b)| *a || *b).collect();
    let own = own_estimates(model, inliers, s.reference, &s.frame, s.size);
    let map = |free: &DVector<f64>| s.frame.homography(&model.parameters(free));
    let in_line = in_line(&own, &displaced);
    (0..own.len())
        .map(|index| {
            let own = own[index].as_ref();
            let expected = rail::predicted(&in_line, coordinates, *jump, index);
            let by_law = expected.as_ref().and_then(|expected| map(&expected.free));
            // the dots of a displaced slice outrank the law
            let expected = expected.as_ref().filter(|_| own.is_none() || !displaced[index]);
            let (combined, source) = rail::combine(own, expected)?;
            let alone = own.and_then(|own| map(&own.free));
            let off_law = alone.zip(by_law).map(|(a, b)| s.apart(&a, &b));
            let sigma = s.corner_sigma(model, &combined);
            let by_itself = own.map_or(0.0, |own| s.corner_sigma(model, own));
            // the dots contributed too little for the slice to count as measured
            let is_by_law = !displaced[index] && by_itself > MAX_OWN_SIGMA && sigma < 0.5 * by_itself;
            Some(Estimate {
                homography: map(&combined.free)?,
                by_law,
                off_law,
                sigma: sigma.hypot(s.floors[index]),
                source: if is_by_law { EstimateSource::Law } else { source },
            })
        })
        .collect()
}

fn rail_linear_estimates(inliers: &[Inliers], s: &Setting) -> Vec<Option<Estimate>> {
    let matches: Vec<&[Match]> =
        inliers.iter().zip(&s.alone).map(|(a, alone)| if *alone { &[][..] } else { &a.evidence.matches[..] }).collect();
    let overlap = inliers.iter().map(|a| a.evidence.overlap).fold(1.0, f64::max);
    let offsets = &s.rail.coordinates;
    let Some(fit) = RailFit::fit(&matches, offsets) else { return inliers.iter().map(|_| None).collect() };
    let own = own_estimates(TransformModel::Homography, inliers, s.reference, &s.frame, s.size);
    let map = |p: &Parameters| s.frame.homography(p);
    (0..inliers.len())
        .map(|index| {
            let homography = map(&fit.parameters(offsets[index]))?;
            let alone = own[index].as_ref().and_then(|o| map(&TransformModel::Homography.parameters(&o.free)));
            // scatter that the dots of a slice share is not noise of single dots
            let shared = transform_models::fit(TransformModel::Similarity, matches[index])
                .and_then(|fit| map(&TransformModel::Similarity.parameters(&fit.free)))
                .map_or(0.0, |h| s.apart(&h, &homography));
            let sigma = s.frame.half * fit.corner_sigma(offsets[index]) * overlap.sqrt();
            Some(Estimate {
                homography,
                by_law: Some(homography),
                off_law: alone.map(|alone| s.apart(&alone, &homography)),
                sigma: sigma.hypot(s.floors[index]).hypot(0.5 * shared),
                source: if matches[index].is_empty() { EstimateSource::Law } else { EstimateSource::Dots },
            })
        })
        .collect()
}
