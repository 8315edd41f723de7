//! `/scans`: the scans, newest first.

use axum::{extract::State, http::Uri, response::Response};
use jiff::Timestamp;
use maud::html;

use super::{
    frame::{Frame, PageUser, Place, pager},
    words::{ago, text},
};
use crate::{
    http::{ApiResult, App, auth::Caller, extract::params},
    store::{PageRequest, scans::ScanFilter},
};

/// Scans on a page.
const ROWS: u32 = 50;

/// The page.
///
/// # Errors
/// `invalid_request` for a cursor that is none.
pub async fn page(State(app): State<App>, caller: Caller, user: PageUser, uri: Uri) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let cursor = params::take(&mut pairs, "cursor");
    let is_first = cursor.is_none();
    let filter = ScanFilter { owner: caller.sees_only(&app), ..ScanFilter::default() };
    let page = app.store.metadata.scans(&filter, &PageRequest { limit: ROWS, cursor }).await?;
    let now = Timestamp::now();
    let frame = Frame { title: "Scans", place: Place::Scans, user: Some(&user), script: None };
    Ok(frame.answer(html! {
        div.head {
            div { h1 { "Scans" } p.soft { "A scan is many views of one object, taken with one rig and lens." } }
            @if user.stacks { a.button.main href=(link!("/send")) { "Send a scan" } }
        }
        @if page.items.is_empty() {
            div.empty {
                p.lead { @if is_first { "There are no scans yet." } @else { "There are no more scans." } }
                @if user.stacks { p { "Send a folder that has a folder for each view, or name a scan when you send a stack." } }
            }
        } @else {
            div.wide tabindex="0" role="region" aria-label="Scans" {
                table {
                    thead { tr {
                        @for head in ["Scan", "Specimen", "Rig", "Lens", "Views", "Created"] { th.l scope="col" { (head) } }
                    } }
                    tbody {
                        @for scan in &page.items {
                            tr {
                                td.l { a href=(link!("/scans/{}", scan.name)) { (scan.name) } }
                                td.l { (text(scan.input.specimen.as_deref().or(scan.input.taxon.as_deref()).unwrap_or("–"))) }
                                td.l { (scan.input.rig) } td.l { (scan.input.lens) }
                                td.l { @if let Some(views) = scan.input.expected_views { (views) " expected" } @else { "–" } }
                                td.l { (ago(scan.created_at, now)) }
                            }
                        }
                    }
                }
            }
        }
        (pager(&link!("/scans"), &[], is_first, page.next_cursor.as_deref()))
    }))
}
