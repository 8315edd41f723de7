//! From measured dots to homographies: inliers, transform model, rail law, gains, and the uncertainty of each slice.

mod estimates;
mod inliers;
mod missing;

use estimates::{Estimate, Setting, corner_errors, estimates, floors};
pub(super) use inliers::find_inliers;
use inliers::{Inliers, drop_mistaken_grids, own_estimates};
use missing::{reference_without_grid, unmeasured_slices};

use super::detection::{Detection, MeasuredDot};
use super::gains::{self, Gain};
use super::lattice::Label;
use super::lost::Loss;
use super::model_selection::{self, Evidence, StackModel};
use super::rail::{self, EstimateSource, Law, OwnEstimate};
use super::rail_anomalies::{self, RailAnomaly};
use super::rail_jumps;
use super::rail_order;
use super::statistics::quantile;
use super::tracking::Tracked;
use super::transform_models::{self, Frame, TransformModel};
use super::{Dot, DotUse, robust};
use crate::imaging::Slices;
use crate::types::calibration_options::ModelChoice;
use crate::types::report::ModelCandidate;
use crate::types::{Control, Error, ErrorKind, Homography, Interrupted};

/// Geometry and gain of one slice.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// The homography by the rail law alone.
    pub by_law: Option<Homography>,
    /// Factor that makes the slice as bright as the reference slice.
    pub gain: f64,
    /// Its relative standard deviation.
    pub gain_sigma: f64,
    /// The gain by the smooth law over the rail; `None` without one.
    pub gain_by_law: Option<f64>,
    /// Brightness over what that law expects, where they differ significantly.
    pub brightness_off_law: Option<f64>,
    /// Standard deviation of the worst image corner, px.
    pub corner_sigma: f64,
    /// RMS residual of the inliers in the reference slice, px; `None` when predicted.
    pub rms: Option<f64>,
    /// 95th percentile of the residuals, px.
    pub p95: Option<f64>,
    /// The dots found.
    pub dots: Vec<Dot>,
    /// Largest distance of an image corner between the slice's own estimate and the rail law, px.
    pub off_law: Option<f64>,
    /// True when predicted by the rail law.
    pub interpolated: bool,
}

/// The solution for the stack.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    /// Index of the reference slice.
    pub reference: usize,
    /// One per slice.
    pub slices: Vec<Solved>,
    /// The selected model, and the reason.
    pub model: (StackModel, String),
    /// What each model would give.
    pub candidates: Vec<ModelCandidate>,
    /// Rail anomalies.
    pub anomalies: Vec<RailAnomaly>,
    /// Rail positions that the law was fitted with.
    pub positions: Vec<f64>,
    /// Rail positions derived from the scales, with standard deviations.
    pub positions_by_scale: Option<Vec<Option<(f64, f64)>>>,
    /// Scale parameter of each measured slice (0 at the reference) with its standard deviation.
    pub scales: Vec<Option<(f64, f64)>>,
    /// Slopes of scale, rotation and shift over the positions, units.
    pub slopes: Option<[f64; 4]>,
}

/// Largest corner uncertainty of a predicted slice, px.
const MAX_PREDICTED_SIGMA: f64 = 1.5;
/// Distance from the rail law, in grid steps, from which the grid of a slice with merged dots counts as mistaken.
const MISTAKEN: f64 = 0.3;

/// Solves every slice. `given`: rail positions that the user specified.
///
/// # Errors
/// An error that names the slices that can neither be measured nor predicted.
pub(super) fn solve(
    slices: &dyn Slices,
    tracked: &Tracked,
    reference: usize,
    given: Option<&[f64]>,
    requested: ModelChoice,
    control: &dyn Control,
) -> Result<Solution, Interrupted> {
    let count = tracked.detections.len();
    let Some(base) = tracked.detections[reference].as_ref() else {
        return Err(reference_without_grid(slices, reference, Loss::of(tracked, reference)).into());
    };
    let frame = Frame::new(tracked.width, tracked.height);
    let (width, height) = (tracked.width as u32, tracked.height as u32);
    let mut inliers: Vec<Inliers> = Vec::with_capacity(count);
    for (index, detection) in tracked.detections.iter().enumerate() {
        control.check()?;
        let other = detection.as_ref().filter(|_| index != reference);
        inliers.push(other.and_then(|s| find_inliers(s, base, &frame)).unwrap_or_default());
    }

    // the similarity model decides about the rail, whichever model is selected in the end
    let mut positions: Vec<f64> = given.map_or_else(|| (0..count).map(|i| i as f64).collect(), <[f64]>::to_vec);
    let similar =
        |inliers: &[Inliers]| own_estimates(TransformModel::Similarity, inliers, reference, &frame, [width, height]);
    let first = similar(&inliers);
    drop_mistaken_grids(&mut inliers, &first, &positions, tracked, base);
    let own = similar(&inliers);
    let sigma = |o: &OwnEstimate, n: usize| o.covariance[(n, n)].max(0.0).sqrt();
    let scale = |own: &[Option<OwnEstimate>]| {
        own.iter().map(|o| o.as_ref().map(|o| (o.free[0], sigma(o, 0)))).collect::<Vec<_>>()
    };
    let order = rail_order::true_order(&scale(&own));
    if let (Some(order), None) = (&order, given) {
        positions = rail_order::ranks(order, count);
    }
    let positions_by_scale = rail::positions_by_scale(&scale(&own), &positions, reference);
    let mut anomalies = match (order, &positions_by_scale) {
        (Some(order), _) => vec![RailAnomaly::OutOfOrder { order }],
        (None, Some(positions_by_scale)) => rail_anomalies::step_anomalies(positions_by_scale, &positions),
        (None, None) => Vec::new(),
    };
    if let (Some(positions_by_scale), false) = (&positions_by_scale, anomalies.is_empty() || given.is_some()) {
        positions = filled(positions_by_scale, &positions);
    }
    let motion = |o: &OwnEstimate| [o.free[2], o.free[3], o.free[1]].map(|v| v * frame.half);
    let motions: Vec<Option<[f64; 3]>> = own.iter().map(|o| o.as_ref().map(motion)).collect();
    let jumps = rail_jumps::find(&motions, &positions, frame.half);
    let jump = jumps.iter().find_map(|a| if let RailAnomaly::Bumped { from, .. } = a { Some(*from) } else { None });
    let displaced: Vec<bool> = (0..count)
        .map(|i| jumps.iter().any(|a| matches!(a, RailAnomaly::Displaced { slice, .. } if *slice == i)))
        .collect();
    anomalies.extend(jumps);
    let in_line: Vec<Option<OwnEstimate>> =
        own.iter().zip(&displaced).map(|(o, displaced)| o.clone().filter(|_| !displaced)).collect();
    let slopes = Law::fit(&in_line, &positions, jump).map(|law| std::array::from_fn(|n| law.slopes()[n]));

    let offsets: Vec<f64> = positions.iter().map(|z| z - positions[reference]).collect();
    let evidence: Vec<Evidence> = inliers.iter().map(|a| a.evidence.clone()).collect();
    let floors = floors(tracked, base.pitch);
    let setting = Setting {
        frame: &frame,
        width,
        height,
        reference,
        positions: &positions,
        offsets: &offsets,
        jump,
        displaced: &displaced,
        floors: &floors,
    };
    let by_model: Vec<(StackModel, Vec<Option<Estimate>>)> = [StackModel::RailLinear]
        .into_iter()
        .chain(transform_models::ALL.map(StackModel::PerSlice))
        .map(|model| (model, estimates(model, &inliers, &setting)))
        .collect();
    let of = |model: StackModel| by_model.iter().find(|e| e.0 == model).map_or(&[][..], |e| &e.1);
    let corner_errors = |model: StackModel| {
        corner_errors(of(model), of(StackModel::PerSlice(TransformModel::Homography)), &inliers, &setting)
    };
    let (model, mut candidates, reason) =
        model_selection::select_model(&evidence, &offsets, frame.half, &corner_errors, requested);
    let (_, hidden) = model_selection::bias(&corner_errors(model));
    for candidate in &mut candidates {
        let Some((_, solution)) = by_model.iter().find(|(m, _)| m.name() == candidate.model) else { continue };
        let others = solution.iter().enumerate().filter(|(i, _)| *i != reference);
        let worst = others.map(|(_, m)| m.as_ref().map(|m| m.sigma)).collect::<Option<Vec<f64>>>();
        candidate.corner_sigma_px = worst.map(|all| all.into_iter().fold(0.0, f64::max));
    }
    let mut solution = by_model.into_iter().find(|e| e.0 == model).map(|e| e.1).unwrap_or_default();
    // the hidden bias grows with the distance on the rail, as the transforms do
    let mean_away = offsets.iter().map(|z| z * z).sum::<f64>() / count as f64;
    for (estimate, z) in solution.iter_mut().zip(&offsets) {
        let share = 0.2 + 0.8 * z * z / mean_away.max(1e-30);
        estimate.iter_mut().for_each(|m| m.sigma = m.sigma.hypot((hidden * share).sqrt()));
    }
    let unmeasured: Vec<usize> = (0..count)
        .filter(|&i| {
            i != reference
                && solution[i].as_ref().is_none_or(|m| m.source == EstimateSource::Law && m.sigma > MAX_PREDICTED_SIGMA)
        })
        .collect();
    if !unmeasured.is_empty() {
        let worst = unmeasured.iter().filter_map(|&i| solution[i].as_ref().map(|m| m.sigma)).fold(0.0, f64::max);
        let why = if worst > 0.0 {
            format!(
                ", and a prediction from the other slices would leave their image corners uncertain by {worst:.1} px (the \
                 limit is {MAX_PREDICTED_SIGMA} px)"
            )
        } else {
            ", and too few other slices were measured to predict them".to_owned()
        };
        return Err(unmeasured_slices(slices, &unmeasured, |i| Loss::of(tracked, i), &why).into());
    }
    let all_gains = gains::of(tracked, reference, &positions);
    let mut out = Vec::with_capacity(count);
    for (index, map) in solution.into_iter().enumerate() {
        let solved = match map {
            Some(map) if index != reference => {
                solved_slice(map, &inliers[index], tracked, index, base, all_gains[index])
            }
            _ => reference_slice(base, all_gains[index]),
        };
        if let Some(why) = solved.homography.violation(width, height) {
            let name = slices.name(index);
            let detail = format!(
                "the homography of {name} (slice {index}) {why}: check that it shows the same target as the reference slice"
            );
            return Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(index as u32)).into());
        }
        out.push(solved);
    }
    let scales = scale(&own);
    Ok(Solution {
        reference,
        slices: out,
        model: (model, reason),
        candidates,
        anomalies,
        positions,
        positions_by_scale,
        scales,
        slopes,
    })
}

/// Positions derived from the scales, extended by ordinary steps where there are none.
fn filled(positions_by_scale: &[Option<(f64, f64)>], positions: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..positions_by_scale.len()).filter(|&i| positions_by_scale[i].is_some()).collect();
    (0..positions_by_scale.len())
        .map(|i| {
            let nearest = known.iter().min_by_key(|k| k.abs_diff(i)).copied().unwrap_or(i);
            positions_by_scale[nearest].map_or(positions[i], |s| s.0) + positions[i] - positions[nearest]
        })
        .collect()
}

/// The reference slice: the identity by definition.
fn reference_slice(base: &Detection, gain: Gain) -> Solved {
    let dot = |(label, dot): (&Label, &MeasuredDot)| Dot {
        label: *label,
        at: dot.at,
        sigma: dot.sigma,
        used: DotUse::Inlier,
    };
    Solved {
        homography: Homography::IDENTITY,
        by_law: None,
        gain: 1.0,
        gain_sigma: 0.0,
        gain_by_law: gain.by_law,
        brightness_off_law: gain.off_law,
        corner_sigma: 0.0,
        rms: Some(0.0),
        p95: Some(0.0),
        dots: base.dots.iter().map(dot).collect(),
        off_law: None,
        interpolated: false,
    }
}

fn solved_slice(
    estimate: Estimate,
    inliers: &Inliers,
    tracked: &Tracked,
    index: usize,
    base: &Detection,
    gain: Gain,
) -> Solved {
    let interpolated = estimate.source == EstimateSource::Law;
    let far = |label: &Label, at: [f64; 2]| {
        base.dots
            .get(label)
            .is_some_and(|b| robust::transfer_error(&estimate.homography, &(at, b.at)) > MISTAKEN * base.pitch)
    };
    let used = |label: &Label, at: [f64; 2]| match inliers.is_inlier.get(label) {
        // the grid was mistaken by half a step
        _ if interpolated && far(label, at) => DotUse::Outlier,
        _ if interpolated => DotUse::Unused,
        Some(true) => DotUse::Inlier,
        Some(false) => DotUse::Outlier,
        None => DotUse::Unused,
    };
    let measured = tracked.detections[index].iter().flat_map(|s| &s.dots);
    let dots: Vec<Dot> =
        measured.map(|(label, d)| Dot { label: *label, at: d.at, sigma: d.sigma, used: used(label, d.at) }).collect();
    let inliers = dots.iter().filter(|d| d.used == DotUse::Inlier);
    let mut errors: Vec<f64> = inliers
        .filter_map(|d| base.dots.get(&d.label).map(|b| robust::transfer_error(&estimate.homography, &(d.at, b.at))))
        .collect();
    let rms = (!errors.is_empty()).then(|| (errors.iter().map(|m| m * m).sum::<f64>() / errors.len() as f64).sqrt());
    Solved {
        homography: estimate.homography,
        by_law: estimate.by_law,
        gain: gain.value,
        gain_sigma: gain.sigma,
        gain_by_law: gain.by_law,
        brightness_off_law: gain.off_law,
        corner_sigma: estimate.sigma,
        rms,
        p95: rms.map(|_| quantile(&mut errors, 0.95)),
        dots,
        off_law: estimate.off_law,
        interpolated,
    }
}
