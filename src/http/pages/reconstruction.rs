//! The part of the page of a scan on its reconstructions: a button, the latest one while it runs, and what it found.

use jiff::Timestamp;
use maud::{Markup, html};
use uuid::Uuid;

use super::{
    model::model_viewer,
    stacks::row,
    words::{count, date, sentence, text},
};
use crate::{
    contract::{
        JobKind, JobState, Name,
        outcome::{JobOutcome, ReconstructionOutcome},
        reconstruction::{ReconstructedHull, ReconstructedView, files},
        scan::Reconstruct,
    },
    http::{ApiResult, App, auth::Caller},
    jobs::reconstruction::INSTALL,
    store::{Job, JobFilter, PageRequest},
};
use pinstack_science::photogrammetry::poses::LengthUnit;

/// Reconstructions that are shown.
const SHOWN: u32 = 5;

/// The latest reconstructions of a scan, with the order of the queue.
///
/// # Errors
/// When the store cannot be read.
pub async fn latest(app: &App, caller: &Caller, scan: &Name) -> ApiResult<(Vec<Job>, Vec<Uuid>)> {
    let filter = JobFilter {
        kind: Some(JobKind::Reconstruction),
        scan: Some(scan.clone()),
        owner: caller.sees_only(app),
        ..JobFilter::default()
    };
    let jobs = app.store.metadata.jobs(&filter, &PageRequest { limit: SHOWN, cursor: None }).await?.items;
    let queue = row::queue(app, &jobs).await?;
    Ok((jobs, queue))
}

/// The section. `may_start`: a person may start one; `has_results`: there are views to reconstruct.
pub fn section(live: &Markup, when: Reconstruct, may_start: bool, has_results: bool, has_colmap: bool) -> Markup {
    html! {
        section {
            h2 { "Reconstruction" }
            p.soft { "COLMAP finds the cameras and points of the object from the fused images. It tells whether the scan can be used, "
                "while the object is still on the table." }
            @if !has_colmap {
                p.told { "No worker of this service has COLMAP: " (INSTALL) "." }
            }
            @if when == Reconstruct::Auto { p { "It begins by itself when all expected views are done, and again after views were replaced." } }
            @if may_start && has_colmap {
                div.buttons { button type="button" id="reconstruct" disabled[!has_results] { "Reconstruct" } }
            }
            p id="reconstruct-told" role="alert" {}
            div id="reconstructions" { (live) }
        }
    }
}

/// What changes while a reconstruction runs.
pub fn live((jobs, queue): &(Vec<Job>, Vec<Uuid>), may_cancel: bool) -> Markup {
    let Some((newest, older)) = jobs.split_first() else { return html! {} };
    let now = Timestamp::now();
    html! {
        div data-state=(newest.state.as_str()) {
            // no time that passes: a table that was opened stays open
            p { "Started " (date(newest.created_at)) " UTC." }
            (row::how(newest, queue, now))
            @if may_cancel && !newest.state.is_final() {
                div.buttons {
                    button type="button" data-cancel=(link!("/v1/reconstructions/{}", newest.id)) disabled[newest.cancel_requested] { "Cancel" }
                }
            }
            @if let Some(error) = &newest.error { p.error { (sentence(&error.detail)) } }
            @if let Some(outcome) = outcome(newest) { (found(newest.id, outcome)) }
        }
        @if !older.is_empty() {
            h3 { "Earlier" }
            ul { @for job in older { li { (date(job.created_at)) ": " (in_short(job)) } } }
        }
    }
}

/// The model of the newest reconstruction that has one. Its script runs once, so it is no part of what changes.
pub fn model((jobs, _): &(Vec<Job>, Vec<Uuid>)) -> Markup {
    let newest = jobs.iter().find_map(|job| outcome(job).filter(|of| of.result.registered > 0).map(|of| (job.id, of)));
    let Some((id, outcome)) = newest else { return html! {} };
    let has = |file: &str| outcome.artifacts.iter().any(|artifact| artifact.name == file);
    let url = |file: &str| has(file).then(|| link!("/v1/reconstructions/{id}/{file}"));
    let [points, cameras, hull, mesh] = [files::POINTS, files::CAMERAS, files::HULL, files::MESH].map(url);
    model_viewer(points.as_deref(), cameras.as_deref(), hull.as_deref(), mesh.as_deref())
}

fn outcome(job: &Job) -> Option<&ReconstructionOutcome> {
    match &job.outcome {
        Some(JobOutcome::Reconstruction(outcome)) => Some(outcome),
        _ => None,
    }
}

fn in_short(job: &Job) -> Markup {
    html! {
        @match (outcome(job), job.state) {
            (Some(outcome), _) => {
                (outcome.result.registered) " of " (outcome.result.expected) " views registered "
                a href=(link!("/v1/reconstructions/{}", job.id)) { "as JSON" }
            }
            (None, JobState::Failed) => "failed",
            (None, JobState::Cancelled) => "cancelled",
            (None, _) => "not finished",
        }
    }
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
}

fn found(id: Uuid, outcome: &ReconstructionOutcome) -> Markup {
    let result = &outcome.result;
    let links = [
        (files::POINTS, "Points (PLY)"),
        (files::CAMERAS, "Cameras (JSON)"),
        (files::HULL, "Surface (GLB)"),
        (files::MESH, "Mesh"),
        (files::MODEL, "Model of COLMAP (zip)"),
        (files::LOG, "Log"),
    ];
    let has = |file: &str| outcome.artifacts.iter().any(|artifact| artifact.name == file);
    html! {
        p.lead {
            (result.registered) " of " (result.expected) " views registered"
            @if result.registered > 0 {
                " · " (count(result.points as usize, "point", "points"))
                " · mean error of reprojection " (number(result.mean_error_px, 2)) " px"
            }
        }
        @if !result.findings.is_empty() {
            ul.warnings { @for finding in &result.findings { li { (sentence(&finding.detail)) } } }
        }
        div.buttons {
            @if has(files::POSES) { a.button.main href=(link!("/v1/reconstructions/{id}/poses?format=html")) { "Report on camera poses" } }
            @for (file, words) in links {
                @if has(file) { a.button href=(link!("/v1/reconstructions/{id}/{file}")) download { (words) } }
            }
        }
        @if let Some(hull) = &result.hull { (surface(hull, result.unit)) }
        details {
            summary { "Table of reconstructed views" }
            (table(&result.views, result.unit))
        }
    }
}

/// Size and volume of the surface, in words.
fn surface(hull: &ReconstructedHull, unit: Option<LengthUnit>) -> Markup {
    let (lengths, volumes, decimals) = match unit {
        Some(LengthUnit::Mm) => ("mm", "mm³", 2),
        Some(LengthUnit::Radius) => ("radii of the turntable", "cubes of that radius", 4),
        None => ("units of the model", "cubes of that unit", 4),
    };
    let [x, y, z] = hull.size.map(|side| format!("{side:.decimals$}"));
    html! {
        p.soft {
            "The surface from the masks (visual hull) measures " (x) " × " (y) " × " (z) " " (lengths)
            ", its volume is " (format!("{:.decimals$}", hull.volume)) " " (volumes) ". Hollows that no outline shows are filled."
            @if !hull.left_out.is_empty() { " Left out, because their masks contradict the others: " (hull.left_out.join(", ")) "." }
        }
    }
}

fn table(views: &[ReconstructedView], unit: Option<LengthUnit>) -> Markup {
    // shares of the radius in percent
    let (times, words) = match unit {
        Some(LengthUnit::Mm) => (1.0, "mm"),
        Some(LengthUnit::Radius) | None => (100.0, "% of the radius"),
    };
    let counted = |value: Option<u32>| value.map_or_else(|| "–".to_owned(), |value| value.to_string());
    html! {
        div.wide tabindex="0" role="region" aria-label="Table of reconstructed views" {
            table {
                thead { tr {
                    th.l scope="col" { "View" } th.l scope="col" { "State" }
                    @for head in ["Features", "Points", "Error px"] { th scope="col" { (head) } }
                    th scope="col" { "From the circle, " (words) } th scope="col" { "Along it, " (words) }
                } }
                tbody {
                    @for view in views {
                        tr {
                            td.l { a href=(link!("/stacks/{}", view.stack)) { (text(&view.name)) } }
                            td.l { @if view.registered { "registered" } @else { span.bad { "not registered" } } }
                            td { (counted(view.features)) } td { (counted(view.points)) } td { (number(view.mean_error_px, 2)) }
                            td { (number(view.radial.map(|length| times * length), 3)) }
                            td { (number(view.tangential.map(|length| times * length), 3)) }
                        }
                    }
                }
            }
        }
    }
}
