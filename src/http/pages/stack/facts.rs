//! What is known about a stack: files, numbers.

use maud::{Markup, html};

use crate::{
    contract::{
        outcome::{ImageInfo, StackOutcome},
        request::StackRequest,
    },
    http::pages::{
        stacks::row::angles,
        words::{bytes, date, duration, text},
    },
    store::Job,
};
use pinstack_science::types::metrics::AlignmentMetrics;

/// The files.
pub fn files(job: &Job, outcome: Option<&StackOutcome>) -> Markup {
    let link = |name: &str| link!("/v1/stacks/{}/{name}", job.id);
    let upload = job.request.upload();
    html! {
        section {
            h2 { "Files" }
            ul {
                @if let Some(outcome) = outcome {
                    @for artifact in &outcome.artifacts {
                        li { a href=(link(&artifact.name)) download { (artifact.name) }
                            span.soft { " " (artifact.media_type.trim_start_matches("image/").to_uppercase()) ", " (bytes(artifact.bytes)) } }
                    }
                    li { a href=(link("metrics")) { "metrics" } span.soft { " JSON" } }
                }
                @if job.upload_removed {
                    li.soft { "The zip was removed at the end of its retention period." }
                } @else {
                    li { a href=(link("upload")) download { "the zip as it was sent" } span.soft { " " (bytes(upload.bytes)) } }
                }
            }
        }
    }
}

/// The numbers.
pub fn facts(job: &Job, request: &StackRequest, outcome: Option<&StackOutcome>) -> Markup {
    let options = &request.options;
    let layout = &request.layout;
    html! {
        section {
            h2 { "About this stack" }
            dl.facts {
                dt { "Rig and lens" }
                dd { a href=(link!("/profiles/{}/{}", job.rig, job.lens)) { (job.rig) " · " (job.lens) }
                    ", profile revision " (request.profile_revision) }
                @if let Some(scan) = &options.scan {
                    dt { "Scan" } dd { a href=(link!("/scans/{scan}")) { (scan) } " " (angles(options)) }
                }
                dt { "Slices" }
                dd { (layout.front.len()) " front light"
                    @if !layout.back.is_empty() { ", " (layout.back.len()) " back light" }
                    @for light in &layout.lights { ", " (light.slices.len()) " " (light.name) }
                    ", " (layout.width) " × " (layout.height) " px, " (layout.bit_depth) " bits" }
                @if let Some(outcome) = outcome { (results(outcome)) }
                dt { "Method" } dd { (json_word(&options.method)) }
                dt { "Accepted" } dd { (date(job.created_at)) " UTC" }
                @if let Some(file) = &request.upload.filename { dt { "Sent as" } dd { (text(file)) } }
                @if let Some(first) = request.rerun_of {
                    dt { "Fused again from" } dd { a href=(link!("/stacks/{first}")) { "the stack that was sent" } }
                }
                dt { "Id" } dd { code { (job.id) } }
            }
        }
    }
}

fn results(outcome: &StackOutcome) -> Markup {
    let ImageInfo { width, height, bit_depth, crop_offset_px: [x, y], .. } = &outcome.image;
    let metrics = &outcome.metrics;
    let percent = |share: Option<f64>| share.map(|share| format!("{:.1} %", 100.0 * share));
    let fits = |of: &AlignmentMetrics| of.residual_p95_px.map(|px| format!("{px:.2} px (95 %)"));
    let rows = [
        ("Never in focus", percent(metrics.focus.unfocused_fraction)),
        ("Object", percent(metrics.mask.as_ref().map(|mask| mask.foreground_fraction))),
        ("Clipped", percent(metrics.fusion.clipped_fraction)),
        ("Slices fit within", fits(&metrics.alignment)),
    ];
    let total = std::time::Duration::from_millis(metrics.timing_ms.total);
    html! {
        dt { "Image" }
        dd { (width) " × " (height) " px, " (bit_depth) " bits" @if (*x, *y) != (0, 0) { ", cropped at " (x) ", " (y) } }
        @if let Some(height) = &outcome.height {
            dt { "Height map" } dd { "in " (json_word(&height.unit)) ", known for " (format!("{:.0} %", 100.0 * height.valid_fraction)) " of the object" }
        }
        @for (name, value) in rows { @if let Some(value) = value { dt { (name) } dd { (value) } } }
        @for light in &metrics.lights {
            @if let Some(value) = fits(&light.alignment) { dt { "Slices of " (light.name) " fit within" } dd { (value) } }
        }
        @if metrics.timing_ms.total > 0 { dt { "Time" } dd { (duration(total)) } }
        @if let Some(software) = &outcome.software { dt { "Made by" } dd { (text(software)) } }
    }
}

/// The name of a value in the API, with blanks.
fn json_word(value: &impl serde::Serialize) -> String {
    let json = serde_json::to_value(value).unwrap_or_default();
    json.as_str().unwrap_or_default().replace('_', " ")
}
