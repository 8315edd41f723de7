//! `/stacks`: the stacks, newest first. The search, the filter and the position are in the URL.
//!
//! A script of the page asks for the rows again (`?part=rows`) while something is in progress: one request for the
//! whole page, whatever the number of stacks, answered with 304 when nothing changed.

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode, Uri, header},
    response::{IntoResponse, Response},
};
use jiff::Timestamp;
use maud::{Markup, html};
use sha2::{Digest, Sha256};

use super::{row, search};
use crate::{
    contract::JobKind,
    http::{
        ApiResult, App,
        auth::Caller,
        extract::{etag, not_modified, params},
        pages::{
            frame::{Frame, PageUser, Place, pager},
            words::text,
        },
    },
    store::{Job, JobFilter, Page, PageRequest},
};

/// Stacks on a page.
const ROWS: u32 = 24;

/// The page, or its rows alone.
///
/// # Errors
/// `invalid_request` for a filter or a cursor that is none.
pub async fn list(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    uri: Uri,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    // a form sends its empty fields too
    pairs.retain(|(_, value)| !value.trim().is_empty());
    let rows_alone = params::take(&mut pairs, "part").is_some();
    let cursor = params::take(&mut pairs, "cursor");
    let filter = JobFilter { owner: caller.sees_only(&app), ..params::job_filter(JobKind::Stack, &pairs)? };
    let is_first = cursor.is_none();
    let page = app.store.metadata.jobs(&filter, &PageRequest { limit: ROWS, cursor }).await?;
    let queue = row::queue(&app, &page.items).await?;
    let rows = rows(&page, &queue);
    if rows_alone {
        return Ok(fragment(&headers, rows));
    }
    let found = app.store.metadata.found(&filter).await?;
    let frame = Frame { title: "Stacks", place: Place::Stacks, user: Some(&user), script: Some("list.js") };
    Ok(frame.answer(html! {
        div.head {
            div { h1 { "Stacks" } p.soft { (search::numbers(&found)) } }
            @if user.stacks { a.button.main href=(link!("/send")) { "Send a stack" } }
        }
        (search::form(&pairs, &found))
        @if page.items.is_empty() && page.skipped.is_empty() {
            (empty(&filter, is_first, &user))
        }
        div id="rows" { (rows) }
        p.soft id="told" role="status" {}
        (pager(&link!("/stacks"), &pairs, is_first, page.next_cursor.as_deref()))
    }))
}

fn rows(page: &Page<Job>, queue: &[uuid::Uuid]) -> Markup {
    let now = Timestamp::now();
    html! {
        ol.rows {
            @for job in &page.items { (row::row(job, queue, now)) }
            @for skipped in &page.skipped {
                li { span.thumb {} div.what { p.bad { (text(&skipped.id)) ": " (text(&skipped.detail)) } } }
            }
        }
    }
}

/// Rows for the script of the page.
fn fragment(headers: &HeaderMap, rows: Markup) -> Response {
    let rows = rows.into_string();
    let digest = Sha256::digest(rows.as_bytes());
    let tag: String = digest[..12].iter().map(|byte| format!("{byte:02x}")).collect();
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"))];
    if not_modified(headers, &tag) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    (common, [(header::CONTENT_TYPE, "text/html; charset=utf-8")], rows).into_response()
}

fn empty(filter: &JobFilter, is_first: bool, user: &PageUser) -> Markup {
    let is_all = JobFilter { kind: filter.kind, owner: filter.owner, ..JobFilter::default() } == *filter;
    html! {
        div.empty {
            @if is_all && is_first {
                p.lead { "There are no stacks yet." }
                p { "A stack needs the profile of its rig and lens. Photograph a " a href=(link!("/plan")) { "dot target" }
                    " at every rail position once, and send these pictures as a calibration. Then send your stacks." }
                @if user.stacks { p { a.button.main href=(link!("/send")) { "Send pictures" } } }
            } @else {
                p.lead { "No stack matches." }
                p { a href=(link!("/stacks")) { "Show all stacks" } }
            }
        }
    }
}
