//! `/stacks/{id}/runs`: the runs of the same pictures beside each other. The ids of the chosen ones are the parameters
//! of the page, so that its address can be sent; without any, the newest are shown.

use axum::{extract::State, http::Uri, response::Response};
use maud::{Markup, html};

use super::comparison::{self, told};
use crate::{
    contract::JobKind,
    http::{
        ApiResult, App,
        auth::Caller,
        extract::{JobId, params},
        job_resource::load,
        pages::{
            frame::{Frame, PageUser, Place},
            stacks::row,
            words::{count, text},
        },
    },
    store::{Job, JobFilter, PageRequest},
};

/// Most runs that are found, the newest.
const MOST: u32 = 24;
/// Runs that are shown if none are chosen.
const SHOWN: usize = 4;

/// The runs of the pictures of a stack that the caller may see, the oldest first; the stack is one of them.
///
/// # Errors
/// When the store cannot be read.
pub async fn of(app: &App, caller: &Caller, job: &Job) -> ApiResult<Vec<Job>> {
    let filter = JobFilter {
        kind: Some(JobKind::Stack),
        zip: Some(job.request.upload().sha256.clone()),
        owner: caller.sees_only(app),
        ..JobFilter::default()
    };
    let mut runs = app.store.metadata.jobs(&filter, &PageRequest { limit: MOST, cursor: None }).await?.items;
    if runs.iter().all(|run| run.id != job.id) {
        runs.push(job.clone());
    }
    runs.reverse();
    runs.sort_by_key(|run| run.created_at);
    Ok(runs)
}

/// The page.
///
/// # Errors
/// `not_found`; `invalid_request` for a parameter that is given twice.
pub async fn page(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    JobId(id): JobId,
    uri: Uri,
) -> ApiResult<Response> {
    let pairs = params::pairs(&uri)?;
    let job = load(&app, id, JobKind::Stack).await?;
    let runs = of(&app, &caller, &job).await?;
    let is_named = |run: &&Job| pairs.iter().any(|(name, _)| *name == run.id.to_string());
    let mut chosen: Vec<&Job> = runs.iter().filter(is_named).collect();
    if chosen.len() < 2 {
        let from = runs.len().saturating_sub(SHOWN);
        chosen = runs.iter().enumerate().filter(|(at, run)| *at >= from || run.id == id).map(|(_, run)| run).collect();
    }
    let title = format!("Runs of {}", row::name(&job));
    let frame = Frame { title: &title, place: Place::Stacks, user: Some(&user), script: None };
    Ok(frame.answer(html! {
        div.head {
            div {
                p.crumbs { a href=(link!("/stacks")) { "Stacks" } " / " a href=(link!("/stacks/{id}")) { (text(&row::name(&job))) } }
                h1 { (text(&title)) }
                p.soft { (count(runs.len(), "run", "runs")) " of the same pictures." }
            }
        }
        @if runs.len() == 1 {
            div.empty { p.lead { "These pictures were fused once." } p { "“Fuse again with other options” on the page of the stack makes another run." } }
        } @else {
            (form(&job, &runs, &chosen))
            (comparison::table(&chosen))
        }
    }))
}

/// The choice of the runs.
fn form(job: &Job, runs: &[Job], chosen: &[&Job]) -> Markup {
    html! {
        form.filters method="get" action=(link!("/stacks/{}/runs", job.id)) aria-label="Choose runs" {
            div.choices {
                @for run in runs {
                    label.check {
                        input type="checkbox" name=(run.id) value="1" checked[chosen.iter().any(|it| it.id == run.id)];
                        (told(run))
                    }
                }
                div.buttons { button type="submit" { "Compare" } }
            }
        }
    }
}
