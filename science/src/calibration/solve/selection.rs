//! The transform model of the stack, and the estimates of all slices under it.

use super::alone::{Deviation, OwnHomographies};
use super::estimates::{Estimate, Setting, corner_errors, estimates};
use super::inliers::Inliers;
use crate::calibration::model_selection::{self, Evidence, Selection, StackModel};
use crate::calibration::transform_models::TransformModel;
use crate::types::calibration_options::ModelChoice;

/// Estimates all slices under every model and selects one. Returns it with its estimates; `None` where there is neither
/// a measurement nor a rail law. A few slices that contradict the model at the corners take part neither in its
/// selection nor in the rail law: they are marked in `setting`, and estimated by their own dots.
pub(super) fn select(
    inliers: &[Inliers],
    setting: &mut Setting,
    requested: ModelChoice,
) -> (Selection, Vec<Option<Estimate>>) {
    let own = OwnHomographies::of(inliers, setting);
    let is_free = requested == ModelChoice::Auto;
    let mut found = if is_free { own.bent(setting) } else { Vec::new() };
    loop {
        found.into_iter().for_each(|i| setting.alone[i] = true);
        let (selection, mut estimates) = select_model(inliers, setting, requested);
        let deviation = |(i, e): (usize, &Option<Estimate>)| own.deviation(i, &e.as_ref()?.homography, setting);
        let deviations: Vec<Option<Deviation>> = estimates.iter().enumerate().map(deviation).collect();
        let differs = |i: &usize| deviations[*i].is_some_and(Deviation::is_clear) && !setting.alone[*i];
        found = (0..inliers.len()).filter(differs).collect();
        let marked = setting.alone.iter().filter(|alone| **alone).count();
        if is_free && !found.is_empty() && own.are_few(marked + found.len()) {
            continue;
        }
        for (i, estimate) in estimates.iter_mut().enumerate() {
            let Some((e, deviation)) = estimate.as_mut().zip(deviations[i]) else { continue };
            match setting.alone[i].then(|| own.alone(i, e, setting)).flatten() {
                Some(alone) => *e = alone,
                None => e.sigma = e.sigma.hypot(deviation.unexplained()),
            }
        }
        return (selection, estimates);
    }
}

fn select_model(inliers: &[Inliers], setting: &Setting, requested: ModelChoice) -> (Selection, Vec<Option<Estimate>>) {
    // the scatter of the dots tells models apart; what displaces all dots together hides no difference between them
    let plain: Vec<Inliers> = inliers.iter().map(Inliers::without_doubts).collect();
    let under_all = |inliers: &[Inliers]| model_selection::ALL.map(|model| (model, estimates(model, inliers, setting)));
    let (mut by_model, by_dots) = (under_all(inliers), under_all(&plain));
    let corner_errors = |model: StackModel| {
        let full = under(&by_dots, StackModel::PerSlice(TransformModel::Homography));
        corner_errors(under(&by_model, model), under(&by_dots, model), full, inliers, setting)
    };
    let none = Evidence::default();
    let evidence: Vec<&Evidence> =
        inliers.iter().zip(&setting.alone).map(|(a, alone)| if *alone { &none } else { &a.evidence }).collect();
    let mut selection = model_selection::select_model(
        &evidence,
        &setting.rail.coordinates,
        setting.frame.half,
        &corner_errors,
        requested,
    );
    let hidden = model_selection::bias(&corner_errors(selection.model)).upper;
    for candidate in &mut selection.candidates {
        let Some((_, estimates)) = by_model.iter().find(|(m, _)| m.name() == candidate.model) else { continue };
        let others = estimates.iter().enumerate().filter(|(i, _)| *i != setting.reference);
        let worst = others.map(|(_, m)| m.as_ref().map(|m| m.sigma)).collect::<Option<Vec<f64>>>();
        candidate.corner_sigma_px = worst.map(|all| all.into_iter().fold(0.0, f64::max));
    }
    let selected = by_model.iter_mut().find(|e| e.0 == selection.model);
    let mut estimates = selected.map(|e| std::mem::take(&mut e.1)).unwrap_or_default();
    add_hidden_bias(&mut estimates, &setting.rail.coordinates, hidden);
    (selection, estimates)
}

/// The estimates of all slices under one model.
fn under(by_model: &[(StackModel, Vec<Option<Estimate>>)], model: StackModel) -> &[Option<Estimate>] {
    by_model.iter().find(|e| e.0 == model).map_or(&[][..], |e| &e.1)
}

/// Adds the bias that the scatter of the slices could hide, mean `hidden` px^2. It grows with the distance on the rail,
/// as the transforms do.
fn add_hidden_bias(estimates: &mut [Option<Estimate>], offsets: &[f64], hidden: f64) {
    let mean_away = offsets.iter().map(|z| z * z).sum::<f64>() / offsets.len() as f64;
    for (estimate, z) in estimates.iter_mut().zip(offsets) {
        let share = 0.2 + 0.8 * z * z / mean_away.max(1e-30);
        estimate.iter_mut().for_each(|m| m.sigma = m.sigma.hypot((hidden * share).sqrt()));
    }
}
