//! What was measured and why it was taken as it is: the small tables of words.

use super::html::{escape, maybe, number, sentence, significant, table};
use crate::types::{
    profile::{CaptureMode, HomographyModel},
    report::{CalibrationReport, CameraReport, RailReport},
};

/// The facts in one list.
pub(super) fn facts(report: &CalibrationReport) -> String {
    let rows = [
        ("Slices", slices(report)),
        ("Target", target(report)),
        ("Model", format!("{}<small>{}</small>", model(report.model), escape(&sentence(&report.model_reason)))),
        ("What moves", capture(report)),
        ("Principal distance", principal_distance(&report.camera)),
        ("Principal point", principal_point(&report.camera)),
        ("Rail", rail(report.rail.as_ref())),
    ];
    let rows: String = rows.iter().map(|(what, html)| format!("<dt>{what}</dt><dd>{html}</dd>\n")).collect();
    format!("<section>\n<h2>What was measured</h2>\n<dl class=\"facts\">\n{rows}</dl>\n</section>\n")
}

/// What each family of maps would have given.
pub(super) fn candidates(report: &CalibrationReport) -> String {
    let head = "<section>\n<h2>Why this model</h2>\n";
    let reason = escape(&sentence(&report.model_reason));
    if report.candidates.is_empty() {
        return format!("{head}<p>{reason}</p>\n<p class=\"hint\">No other families were compared.</p>\n</section>\n");
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
    let heads = ["family", "free numbers", "RMS, px", "held-out, px", "BIC", "corner σ, px", ""];
    format!(
        "{head}<p>{reason}</p>\n<div class=\"c\">{}</div>\n\
         <p class=\"hint\">RMS: how well the dots fit that were used. Held-out: how well those fit that were not; a family \
         that is too rich is good in the first and bad in the second. BIC: both in one number, less is better. Corner σ: \
         how well the worst corner of the worst slice is then known.</p>\n</section>\n",
        table("Families of maps", &heads, &rows)
    )
}

fn slices(report: &CalibrationReport) -> String {
    let count = report.slices.len();
    let guessed = report.slices.iter().filter(|slice| slice.interpolated).count();
    let interpolated = if guessed > 0 { format!(", {guessed} of them interpolated") } else { String::new() };
    format!(
        "{count} of {} × {} px{interpolated}<small>All are mapped to slice {}, the reference.</small>",
        report.width, report.height, report.reference_index
    )
}

fn target(report: &CalibrationReport) -> String {
    let target = &report.target;
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
        (Some(told), Some(found)) if told == found => format!("{} <small>As told, and as found.</small>", mode(told)),
        (Some(told), Some(found)) => {
            format!("<strong>Told: {}. But the scales show: {}.</strong>", mode(told), mode(found))
        }
        (Some(told), None) => format!("{} <small>As told; the scales leave it open.</small>", mode(told)),
        (None, Some(found)) => format!("{} <small>As found; it was not told.</small>", mode(found)),
        (None, None) => "Not told, and left open by the scales".to_owned(),
    };
    format!("{first}<small>{}</small>", escape(&sentence(&capture.detail)))
}

fn principal_distance(camera: &CameraReport) -> String {
    let known = match (camera.principal_distance_mm, camera.principal_distance_px) {
        (Some(mm), Some(px)) => format!("{} mm = {} px", number(mm, 3), number(px, 1)),
        (Some(mm), None) => format!("{} mm", number(mm, 3)),
        (None, Some(px)) => format!("{} px", number(px, 1)),
        (None, None) => "Not known".to_owned(),
    };
    let check = match (camera.cross_check_mm, camera.principal_distance_mm) {
        (Some(other), Some(mm)) if mm > 0.0 => {
            format!("; by another way {} mm ({} %)", number(other, 3), signed(100.0 * (other / mm - 1.0), 1))
        }
        (Some(other), _) => format!("; by another way {} mm", number(other, 3)),
        (None, _) => String::new(),
    };
    let mut told = Vec::new();
    if let Some(focal) = camera.focal_mm {
        told.push(format!("Focal length told: {} mm", significant(focal, 4)));
    }
    if let Some(pitch) = camera.pixel_pitch_mm {
        told.push(format!("pixel size told: {} mm", significant(pitch, 4)));
    }
    let told = if told.is_empty() { String::new() } else { format!("<small>{}</small>", told.join("; ")) };
    format!("{known}{check}<small>{}</small>{told}", escape(&sentence(&camera.detail)))
}

fn signed(value: f64, decimals: usize) -> String {
    let text = number(value, decimals);
    if value > 0.0 { format!("+{text}") } else { text }
}

fn principal_point(camera: &CameraReport) -> String {
    match camera.principal_point_px {
        Some([x, y]) => format!("({}, {}) px in the reference slice", number(x, 1), number(y, 1)),
        None => "Not known".to_owned(),
    }
}

fn rail(rail: Option<&RailReport>) -> String {
    let Some(rail) = rail else {
        return "No law was fitted<small>It takes at least three measured slices whose scales differ.</small>"
            .to_owned();
    };
    let (step, unit) = if rail.in_mm { ("mm", " mm") } else { ("slice", " of a step") };
    let fixed = match rail.fixed_point_px {
        Some([x, y]) => format!("the point ({}, {}) px stays where it is", number(x, 1), number(y, 1)),
        None => "the image hardly scales".to_owned(),
    };
    let stray = rail
        .positions
        .iter()
        .zip(&rail.measured_positions)
        .enumerate()
        .filter_map(|(i, (at, measured))| measured.map(|measured| (i, (measured - at).abs())))
        .filter(|(_, off)| off.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let stray = match stray {
        Some((slice, off)) => {
            format!("; the scales put slice {slice} farthest from its place, {}{unit}", significant(off, 2))
        }
        None => String::new(),
    };
    format!(
        "The image grows by {} per {step}; {fixed}<small>The slices keep to this law within {} px RMS at the corners{stray}.</small>",
        per_cent(rail.growth),
        number(rail.corner_rms_px, 3),
    )
}

/// Growth as a reader says it: per cent.
fn per_cent(growth: f64) -> String {
    format!("{} %", significant(100.0 * growth, 4))
}

fn mode(mode: CaptureMode) -> &'static str {
    match mode {
        CaptureMode::FixedLens => "The lens stands still and the sensor moves",
        CaptureMode::MovingLens => "Camera and lens move together",
    }
}

fn model(model: HomographyModel) -> &'static str {
    match model {
        HomographyModel::RailLinear => "Law of the rail",
        HomographyModel::Similarity => "Similarity",
        HomographyModel::Affine => "Affine",
        HomographyModel::Homography => "Homography",
        HomographyModel::RigParameters => "Computed from the rig",
        HomographyModel::Given => "As given",
    }
}
