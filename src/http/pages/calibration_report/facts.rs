//! The list of facts (target or stacks, model, capture mode, camera, rail) and the table of transform models.

use super::html::{escape, maybe, number, sentence, significant, table};
use pinstack_science::types::{
    profile::{CaptureMode, HomographyModel},
    report::{CalibrationReport, CameraReport, TargetReport},
};

/// Least distance of a slice from its rail position that is stated: steps or mm.
const NOTICEABLE: f64 = 1e-4;

/// The facts as a definition list.
pub(super) fn facts(report: &CalibrationReport) -> String {
    let rows = [
        ("Slices", slices(report)),
        report.target.as_ref().map_or_else(|| ("Made from", by_stacks(report)), |of| ("Target", target(of))),
        ("Model", format!("{}<small>{}</small>", model(report.model), escape(&sentence(&report.model_reason)))),
        ("What moves", capture(report)),
        ("Principal distance", principal_distance(&report.camera)),
        ("Principal point", principal_point(&report.camera)),
        ("Rail", rail(report)),
    ];
    let rows: String = rows.iter().map(|(what, html)| format!("<dt>{what}</dt><dd>{html}</dd>\n")).collect();
    format!("<section>\n<h2>What was measured</h2>\n<dl class=\"facts\">\n{rows}</dl>\n</section>\n")
}

/// The table that compares the transform models.
pub(super) fn candidates(report: &CalibrationReport) -> String {
    let head = "<section>\n<h2>Why this model</h2>\n";
    let reason = escape(&sentence(&report.model_reason));
    if report.candidates.is_empty() {
        return format!("{head}<p>{reason}</p>\n<p class=\"hint\">No other models were compared.</p>\n</section>\n");
    }
    let rows: Vec<(&str, Vec<String>)> = report
        .candidates
        .iter()
        .map(|candidate| {
            let chosen = if candidate.chosen { "✓ chosen" } else { "" };
            let cells = vec![
                model(candidate.model).to_owned(),
                candidate.parameters.to_string(),
                maybe(candidate.rms_px, 4),
                maybe(candidate.held_out_px, 4),
                maybe(candidate.bic, 0),
                maybe(candidate.corner_sigma_px, 3),
                chosen.to_owned(),
            ];
            (if candidate.chosen { "chosen" } else { "" }, cells)
        })
        .collect();
    let heads = ["model", "parameters", "RMS, px", "held-out, px", "BIC", "corner σ, px", ""];
    let columns = match report.target {
        Some(_) => {
            "RMS: residual of the dots used in the fit. Held-out: residual of dots left out of the fit; a model \
             with too many parameters has a low RMS and a high held-out residual. BIC: Bayesian information criterion, less \
             is better."
        }
        None => "RMS: how far windows of detail lie from where the model maps those of other slices.",
    };
    format!(
        "{head}<p>{reason}</p>\n<div class=\"c\">{}</div>\n<p class=\"hint\">{columns} Corner σ: standard deviation of the \
         worst image corner of the worst slice.</p>\n</section>\n",
        table("Transform models", &heads, &rows)
    )
}

fn slices(report: &CalibrationReport) -> String {
    let count = report.slices.len();
    let predicted = report.slices.iter().filter(|slice| slice.interpolated).count();
    let interpolated = if predicted > 0 { format!(", {predicted} of them interpolated") } else { String::new() };
    format!(
        "{count} of {} × {} px{interpolated}<small>Numbered from 0; all are mapped to slice {}, the reference.</small>",
        report.width, report.height, report.reference_index
    )
}

/// What a calibration without a target is, and what its uncertainty means.
fn by_stacks(report: &CalibrationReport) -> String {
    let worst = report.slices.iter().map(|slice| slice.corner_sigma_px).fold(0.0, f64::max);
    format!(
        "Pictures of objects, without a dot target<small>Slices were aligned by the detail that they share. The standard \
         deviation of the worst image corner is {} px: expect every slice to lie on the others within three times that. It is \
         largest where the objects show no detail; more views, with detail up to the corners, make it \
         smaller.</small>",
        number(worst, 2)
    )
}

fn target(target: &TargetReport) -> String {
    let kind = if target.bright_dots { "bright dots on dark" } else { "dark dots on bright" };
    let rows = if target.asymmetric { ", every other row shifted by half a step" } else { "" };
    let pitch = target.pitch_mm.map(|mm| format!(" = {} mm", significant(mm, 4))).unwrap_or_default();
    let size = target.magnification.map(|m| format!("; magnification {}", significant(m, 4))).unwrap_or_default();
    let fill = match target.fill > 0.0 {
        true => format!("; a dot is {} of the pitch wide", number(target.fill, 2)),
        false => String::new(),
    };
    format!(
        "{} {kind}{rows}<small>Pitch {} px{pitch}{fill}; they span {} % of the reference slice{size}.</small>",
        target.dots,
        number(target.pitch_px, 2),
        number(100.0 * target.coverage, 0),
    )
}

fn capture(report: &CalibrationReport) -> String {
    let capture = &report.capture;
    let first = match (capture.told, capture.found) {
        (Some(given), Some(found)) if given == found => {
            format!("{} <small>Specified, and confirmed by the scales.</small>", mode(given))
        }
        (Some(given), Some(found)) => {
            format!("<strong>Specified: {}. But the scales show: {}.</strong>", mode(given), mode(found))
        }
        (Some(given), None) => format!("{} <small>Specified; the scales do not decide it.</small>", mode(given)),
        (None, Some(found)) => format!("{} <small>Found from the scales; not specified.</small>", mode(found)),
        (None, None) => "Not specified, and not decided by the scales".to_owned(),
    };
    format!("{first}<small>{}</small>", escape(&sentence(&capture.detail)))
}

fn principal_distance(camera: &CameraReport) -> String {
    let pupils = &camera.pupils;
    let with_sigma = |value: f64, sigma: Option<f64>, unit: &str| {
        sigma.map_or_else(
            || format!("{}{unit}", significant(value, 5)),
            |sigma| format!("{} ± {}{unit}", number(value, 3), significant(sigma, 2)),
        )
    };
    let px = camera.principal_distance_px.map(|px| format!(" = {} px", number(px, 1))).unwrap_or_default();
    let known = match camera.principal_distance_mm {
        Some(mm) => with_sigma(mm, pupils.principal_distance_sigma_mm, " mm") + &px,
        None => "Not known".to_owned(),
    };
    let (exit, entrance) = (pupils.exit_pupil_distance_mm, pupils.entrance_pupil_distance_mm);
    let lens = [
        ("exit pupil to sensor", exit, pupils.exit_pupil_distance_sigma_mm, " mm"),
        ("entrance pupil to the plane in focus", entrance, pupils.entrance_pupil_distance_sigma_mm, " mm"),
        ("pupil ratio", pupils.pupil_ratio, pupils.pupil_ratio_sigma, ""),
        ("measured focal length", camera.measured_focal_mm, None, " mm"),
        ("specified focal length", camera.focal_mm, None, " mm"),
        ("specified pixel pitch", camera.pixel_pitch_mm, None, " mm"),
    ];
    let lens: Vec<String> = lens
        .into_iter()
        .filter_map(|(name, value, sigma, unit)| Some(format!("{name} {}", with_sigma(value?, sigma, unit))))
        .collect();
    let lens = match lens.is_empty() {
        true => String::new(),
        false => format!("<small>{}</small>", sentence(&lens.join("; "))),
    };
    format!("{known}<small>{}</small>{lens}", escape(&sentence(&camera.detail)))
}

fn principal_point(camera: &CameraReport) -> String {
    match camera.principal_point_px {
        Some([x, y]) => format!("({}, {}) px in the reference slice", number(x, 1), number(y, 1)),
        None => "Not known".to_owned(),
    }
}

fn rail(report: &CalibrationReport) -> String {
    let Some(rail) = &report.rail else {
        return "No rail law was fitted<small>A fit needs at least four measured slices.</small>".to_owned();
    };
    let (step, unit) = if rail.in_mm { ("mm", " mm") } else { ("slice", " of a step") };
    let fixed = match rail.fixed_point_px {
        Some([x, y]) => format!("the fixed point is ({}, {}) px", number(x, 1), number(y, 1)),
        None => "the scale is nearly constant".to_owned(),
    };
    let farthest = rail
        .positions
        .iter()
        .zip(&rail.measured_positions)
        .enumerate()
        .filter_map(|(i, (at, measured))| measured.map(|measured| (i, (measured - at).abs())))
        .filter(|(_, off)| off.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let farthest = match farthest {
        Some((_, off)) if off < NOTICEABLE => "; the scales agree with the rail positions".to_owned(),
        Some((slice, off)) => {
            format!("; by its scale, slice {slice} is {}{unit} from its rail position, the most", significant(off, 2))
        }
        None => String::new(),
    };
    let fit = match report.target {
        Some(_) => format!(
            "<small>The slices fit the rail law to {} px RMS at the corners{farthest}.</small>",
            number(rail.corner_rms_px, 3)
        ),
        None => String::new(),
    };
    format!("The image grows by {} % per {step}; {fixed}{fit}", significant(100.0 * rail.growth, 4))
}

fn mode(mode: CaptureMode) -> &'static str {
    match mode {
        CaptureMode::FixedLens => "The lens is fixed and the sensor moves",
        CaptureMode::MovingLens => "Camera and lens move together",
        CaptureMode::LensAlone => "The lens moves alone",
    }
}

fn model(model: HomographyModel) -> &'static str {
    match model {
        HomographyModel::RailLinear => "Rail law",
        HomographyModel::RailShifts => "Rail law, a shift per slice",
        HomographyModel::Similarity => "Similarity",
        HomographyModel::Affine => "Affine",
        HomographyModel::Homography => "Homography",
        HomographyModel::RigParameters => "Computed from rig parameters",
        HomographyModel::Given => "As supplied",
    }
}
