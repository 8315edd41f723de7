//! A stack as a row of a list: picture, name, state, and what the user should know in words.

use std::time::Duration;

use jiff::Timestamp;
use maud::{Markup, html};
use uuid::Uuid;

use super::thumbnail;
use crate::{
    contract::{JobKind, JobState, Priority, options::StackOptions, request::JobRequest, verdict::explained},
    http::{
        App,
        pages::words::{ago, count, duration, ordinal, phrase, sentence, state, text, verdict},
    },
    store::{Job, StoreResult},
};

/// Most waiting jobs whose place is told.
const MAX_PLACES: u32 = 1000;
/// Least fraction from which the time left is estimated.
const MIN_FRACTION: f64 = 0.05;

/// The ids of the waiting jobs, the next one first. Read only when one of `jobs` waits.
///
/// # Errors
/// When the store cannot be read.
pub async fn queue(app: &App, jobs: &[Job]) -> StoreResult<Vec<Uuid>> {
    match jobs.iter().any(|job| job.state == JobState::Queued) {
        true => app.store.metadata.queued(MAX_PLACES).await,
        false => Ok(Vec::new()),
    }
}

/// The options of a stack.
pub fn options(job: &Job) -> Option<&StackOptions> {
    match &job.request {
        JobRequest::Stack(request) => Some(&request.options),
        JobRequest::Calibration(_) | JobRequest::Reconstruction(_) => None,
    }
}

/// What people call a job: its label, its place in a scan, or the name of its file.
pub fn name(job: &Job) -> String {
    let angles = options(job).map(angles).unwrap_or_default();
    let scan = job.request.scan().map(|scan| format!("{scan} {angles}").trim().to_owned());
    let label = options(job).and_then(|options| options.label.clone()).filter(|label| !label.trim().is_empty());
    let file = job.request.upload().filename.clone();
    let kind = match job.request.kind() {
        JobKind::Stack => "Stack",
        JobKind::Calibration => "Calibration",
        JobKind::Reconstruction => "Reconstruction",
    };
    let id = job.id.simple().to_string();
    label.or(scan).or(file).unwrap_or_else(|| format!("{kind} {}", id.get(24..).unwrap_or_default()))
}

/// URL of the page of a job.
fn page(job: &Job) -> String {
    match &job.request {
        JobRequest::Stack(_) => link!("/stacks/{}", job.id),
        JobRequest::Calibration(_) => link!("/calibrations/{}", job.id),
        JobRequest::Reconstruction(request) => link!("/scans/{}", request.scan),
    }
}

/// Pan and tilt, as far as they are known.
pub fn angles(options: &StackOptions) -> String {
    let of = |name: &str, angle: Option<f64>| angle.map(|angle| format!("{name} {angle}°"));
    let known: Vec<String> = [of("pan", options.pan_deg), of("tilt", options.tilt_deg)].into_iter().flatten().collect();
    known.join(", ")
}

/// The row.
pub fn row(job: &Job, queue: &[Uuid], now: Timestamp) -> Markup {
    html! {
        li id={ "job-" (job.id) } data-state=(job.state.as_str()) {
            (thumbnail::picture(job))
            div.what {
                a.name href=(page(job)) { (text(&name(job))) }
                div.meta {
                    (job.rig) " · " (job.lens)
                    @if let Some(scan) = job.request.scan() {
                        " · scan " a href=(link!("/scans/{scan}")) { (scan) }
                        @if let Some(angles) = options(job).filter(|options| options.label.is_some()).map(angles).filter(|angles| !angles.is_empty()) { ", " (angles) }
                    }
                    " · " (ago(job.created_at, now))
                }
                @if let Some(error) = &job.error {
                    p.bad { (sentence(&error.detail)) }
                } @else if let Some(worst) = explained(&job.warnings, &[]).first() {
                    p.found {
                        (phrase(&worst.explanation)) "."
                        @if job.warnings.len() > 1 { " " span.soft { "And " (count(job.warnings.len() - 1, "more warning", "more warnings")) "." } }
                    }
                }
            }
            div.how { (how(job, queue, now)) }
        }
    }
}

/// State, progress, time left or place in the queue.
pub fn how(job: &Job, queue: &[Uuid], now: Timestamp) -> Markup {
    html! {
        @match job.verdict() {
            Some(found) => (verdict(found)),
            None => (state(job.state)),
        }
        @match job.state {
            JobState::Running => {
                progress max="1" value=(format!("{:.3}", job.progress.fraction)) aria-label="Progress" {}
                div.soft { (stage(job)) }
                @if job.cancel_requested { div.soft { "is being cancelled" } }
                @else if let Some(left) = left(job, now) { div.soft { "about " (duration(left)) " left" } }
            }
            JobState::Queued => {
                @if let Some(place) = queue.iter().position(|id| *id == job.id) {
                    div.soft { @if place == 0 { "next" } @else { (ordinal(place + 1)) " in the queue" } }
                }
                @match job.request.priority() {
                    Priority::High => div.soft { "high priority" },
                    Priority::Normal => {}
                    Priority::Low => div.soft { "low priority" },
                }
            }
            _ => {
                @if let (Some(began), Some(ended)) = (job.started_at, job.finished_at) {
                    div.soft { "took " (duration(Duration::try_from(ended.duration_since(began)).unwrap_or_default())) }
                }
            }
        }
    }
}

fn stage(job: &Job) -> String {
    let progress = &job.progress;
    match progress.total {
        0 | 1 => progress.stage.clone(),
        total => format!("{} {} of {total}", progress.stage, progress.completed),
    }
}

/// The time that a running job still needs if it goes on as before. `None` near its beginning, and in a later attempt:
/// only the time at which the first began is known.
fn left(job: &Job, now: Timestamp) -> Option<Duration> {
    if job.attempt > 1 {
        return None;
    }
    let passed = Duration::try_from(now.duration_since(job.started_at?)).ok()?;
    let fraction = job.progress.fraction;
    (fraction >= MIN_FRACTION).then(|| passed.mul_f64(((1.0 - fraction) / fraction).clamp(0.0, 100.0)))
}
