//! `/stacks/{id}`: one stack. With `?compare={id}` the viewer also has the layers of another stack; a stack that was
//! fused again is compared with the one that was sent.

use axum::{
    extract::State,
    http::{HeaderValue, Uri, header},
    response::{IntoResponse, Response},
};
use jiff::Timestamp;
use maud::{Markup, html};
use uuid::Uuid;

use super::{actions, facts, findings::Findings, plots, relief, runs, tiles::lights_shown, viewer::Shown};
use crate::{
    contract::{JobKind, JobState, request::JobRequest},
    http::{
        ApiResult, App,
        artifacts::outcome::of_stack,
        auth::Caller,
        extract::{JobId, params},
        job_resource::{load, not_found},
        pages::{
            frame::{Frame, PageUser, Place},
            notes,
            profiles::camera,
            stacks::row,
            words::{sentence, text},
        },
    },
    store::{Job, notes::Subject},
};

/// The page, or its state alone for the script that follows it (`?part=state`).
///
/// # Errors
/// `not_found`.
pub async fn page(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    JobId(id): JobId,
    uri: Uri,
) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let job = load(&app, id, JobKind::Stack).await?;
    let JobRequest::Stack(request) = &job.request else { return Err(not_found(id, JobKind::Stack)) };
    let queue = row::queue(&app, std::slice::from_ref(&job)).await?;
    let state = state(&job, &queue);
    if params::take(&mut pairs, "part").is_some() {
        let headers = [
            (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
            (header::CACHE_CONTROL, HeaderValue::from_static("private, no-store")),
        ];
        return Ok((headers, state.into_string()).into_response());
    }
    let named = params::take(&mut pairs, "compare").and_then(|id| Uuid::parse_str(&id).ok());
    let other = compared(&app, &caller, named.or(request.rerun_of).filter(|other| *other != id)).await?;
    let outcome = of_stack(&job).ok();
    let mut runs = runs::of(&app, &caller, &job).await?;
    runs.retain(|run| run.id != id);
    let lights = lights_shown(&app, &job);
    let name = row::name(&job);
    let reference = app.store.metadata.profile_of_job(&job.rig, &job.lens, request.profile_revision).await?;
    let mm_per_px = reference.as_ref().and_then(|profile| relief::mm_per_px(&profile.input));
    let reference = reference.map(|profile| profile.input.reference_index as usize);
    let current = app.store.metadata.profile(&job.rig, &job.lens, None).await?.map(|profile| profile.input);
    let findings = Findings::of(&app, &job, request, &user).await?;
    let notes = notes::section(&app, &caller, &Subject::Stack(id), user.stacks).await?;
    let frame = Frame { title: &name, place: Place::Stacks, user: Some(&user), script: Some("stack.js") };
    Ok(frame.answer(html! {
        div.head {
            div {
                p.crumbs { a href=(link!("/stacks")) { "Stacks" } }
                h1 { (text(&name)) }
            }
            (actions::buttons(&job, &user))
        }
        p id="told" role="alert" {}
        div id="state" data-stack=(id) { (state) }
        (findings.serious())
        @if let Some(outcome) = outcome {
            (Shown { job: &job, outcome, lights: &lights, runs: &runs, beside: other.as_ref(), mm_per_px }.section())
        }
        @if !runs.is_empty() {
            p { a href=(link!("/stacks/{id}/runs")) { "Compare the " (runs.len() + 1) " runs of these pictures" } }
        }
        @if let Some(outcome) = outcome {
            (camera::missing_in_results(current.as_ref(), outcome.image.intrinsics.is_some(), &job.rig, &job.lens,
                "“Fuse again with other options” with the current revision gives it to the image"))
        }
        (findings.notes())
        (notes)
        (actions::rerun(&job, &user))
        @if let Some(outcome) = outcome { (plots::plots(&outcome.metrics, reference)) }
        div.columns {
            (facts::facts(&job, request, outcome))
            (facts::files(&job, outcome))
        }
    }))
}

fn state(job: &Job, queue: &[Uuid]) -> Markup {
    html! {
        div data-state=(job.state.as_str()) {
            (row::how(job, queue, Timestamp::now()))
            @if let Some(error) = &job.error {
                p.error { (sentence(&error.detail)) }
                @for place in &error.locations { p.small.soft { (text(&place.detail)) } }
            }
            @if job.state == JobState::Cancelled { p.soft { "It was cancelled, so it has no results." } }
        }
    }
}

/// The stack to compare with, if the caller may see it.
async fn compared(app: &App, caller: &Caller, id: Option<Uuid>) -> ApiResult<Option<Job>> {
    let Some(id) = id else { return Ok(None) };
    if let Some(own) = caller.sees_only(app)
        && app.store.metadata.owner(id).await?.is_some_and(|owner| owner != own)
    {
        return Ok(None);
    }
    Ok(app.store.metadata.job(id).await?.filter(|job| job.request.kind() == JobKind::Stack))
}
