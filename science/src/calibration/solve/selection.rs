//! The transform model of the stack, and the estimates of all slices under it.

use super::estimates::{Estimate, Setting, corner_errors, estimates};
use super::inliers::Inliers;
use crate::calibration::model_selection::{self, Evidence, Selection, StackModel};
use crate::calibration::transform_models::TransformModel;
use crate::types::calibration_options::ModelChoice;

/// Estimates all slices under every model and selects one. Returns it with its estimates; `None` where there is neither
/// a measurement nor a rail law.
pub(super) fn select(
    inliers: &[Inliers],
    setting: &Setting,
    requested: ModelChoice,
) -> (Selection, Vec<Option<Estimate>>) {
    let mut by_model = model_selection::ALL.map(|model| (model, estimates(model, inliers, setting)));
    let of = |model: StackModel| by_model.iter().find(|e| e.0 == model).map_or(&[][..], |e| &e.1);
    let corner_errors = |model: StackModel| {
        corner_errors(of(model), of(StackModel::PerSlice(TransformModel::Homography)), inliers, setting)
    };
    let evidence: Vec<&Evidence> = inliers.iter().map(|a| &a.evidence).collect();
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

/// Adds the bias that the scatter of the slices could hide, mean `hidden` px^2. It grows with the distance on the rail,
/// as the transforms do.
fn add_hidden_bias(estimates: &mut [Option<Estimate>], offsets: &[f64], hidden: f64) {
    let mean_away = offsets.iter().map(|z| z * z).sum::<f64>() / offsets.len() as f64;
    for (estimate, z) in estimates.iter_mut().zip(offsets) {
        let share = 0.2 + 0.8 * z * z / mean_away.max(1e-30);
        estimate.iter_mut().for_each(|m| m.sigma = m.sigma.hypot((hidden * share).sqrt()));
    }
}
