//! `/calibrations/{id}`: a calibration while it runs, and its verdict. The report is a page of its own.

use axum::{extract::State, http::Uri, response::Response};
use jiff::Timestamp;
use maud::{Markup, html};
use uuid::Uuid;

use super::camera;
use crate::{
    contract::{JobKind, artifact::REPORT},
    http::{
        ApiResult, App,
        artifacts::outcome::of_calibration,
        extract::{JobId, params},
        job_resource::load,
        pages::{
            frame::{Frame, PageUser, Place, respond},
            stacks::row,
            words::{sentence, text},
        },
    },
    store::Job,
};
use pinstack_science::types::profile::ProfileInput;

/// The page, or its state alone for the script that follows it (`?part=state`).
///
/// # Errors
/// `not_found`.
pub async fn page(State(app): State<App>, user: PageUser, JobId(id): JobId, uri: Uri) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let job = load(&app, id, JobKind::Calibration).await?;
    let queue = row::queue(&app, std::slice::from_ref(&job)).await?;
    let made = match of_calibration(&job).ok().and_then(|outcome| outcome.profile_revision) {
        Some(revision) => app.store.metadata.profile_of_job(&job.rig, &job.lens, revision).await?,
        None => None,
    };
    let state = state(&job, &queue, made.as_ref().map(|profile| &profile.input));
    if params::take(&mut pairs, "part").is_some() {
        return Ok(respond(state));
    }
    let name = row::name(&job);
    let frame = Frame { title: &name, place: Place::Profiles, user: Some(&user), script: Some("job.js") };
    Ok(frame.answer(html! {
        div.head {
            div {
                p.crumbs { a href=(link!("/profiles")) { "Profiles" } " / Calibration" }
                h1 { (text(&name)) }
                p.soft { a href=(link!("/profiles/{}/{}", job.rig, job.lens)) { (job.rig) " · " (job.lens) } }
            }
            @if user.profiles && !job.state.is_final() {
                div.buttons { button type="button" id="cancel" disabled[job.cancel_requested] { "Cancel" } }
            }
        }
        p id="told" role="alert" {}
        div id="state" data-url=(link!("/v1/calibrations/{id}")) { (state) }
    }))
}

/// The verdict, with the camera of the profile that the calibration made.
fn state(job: &Job, queue: &[Uuid], made: Option<&ProfileInput>) -> Markup {
    let outcome = of_calibration(job).ok();
    html! {
        div data-state=(job.state.as_str()) {
            (row::how(job, queue, Timestamp::now()))
            @if let Some(error) = &job.error {
                p.error { (sentence(&error.detail)) }
                @for place in &error.locations { p.small.soft { (text(&place.detail)) } }
            }
            @if let Some(outcome) = outcome {
                p.lead { (sentence(&outcome.verdict)) }
                @if outcome.artifacts.iter().any(|artifact| artifact.name == REPORT) {
                    p { a.button.main href=(link!("/v1/calibrations/{}/report", job.id)) { "Open the report" } }
                }
                @if let Some(revision) = outcome.profile_revision { p { "It is revision " (revision) " of the profile." } }
                @match made {
                    Some(input) if input.principal_distance_px().is_some() => { h2 { "Camera" } dl.facts { (camera::facts(input)) } }
                    Some(_) => (camera::missing(&job.rig, &job.lens)),
                    None => {}
                }
            }
            @if !job.warnings.is_empty() {
                h2 { "Warnings" }
                ul.warnings { @for warning in &job.warnings { li { (sentence(&warning.detail)) } } }
            }
        }
    }
}
