//! `/profiles`: the current profiles, and the latest calibrations.

use axum::{extract::State, http::Uri, response::Response};
use jiff::Timestamp;
use maud::html;

use crate::{
    contract::JobKind,
    http::{
        ApiResult, App,
        extract::params,
        pages::{
            frame::{Frame, PageUser, Place, pager},
            stacks::row::name,
            words::{ago, sentence, state, text},
        },
    },
    store::{JobFilter, PageRequest},
};

/// Profiles on a page.
const ROWS: u32 = 50;
/// Calibrations on the page.
const CALIBRATIONS: u32 = 10;

/// The page.
///
/// # Errors
/// `invalid_request` for a cursor that is none.
pub async fn page(State(app): State<App>, user: PageUser, uri: Uri) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let cursor = params::take(&mut pairs, "cursor");
    let is_first = cursor.is_none();
    let profiles = app.store.metadata.profiles(None, None, &PageRequest { limit: ROWS, cursor }).await?;
    let filter = JobFilter { kind: Some(JobKind::Calibration), ..JobFilter::default() };
    let calibrations = app.store.metadata.jobs(&filter, &PageRequest { limit: CALIBRATIONS, cursor: None }).await?;
    let now = Timestamp::now();
    let frame = Frame { title: "Profiles", place: Place::Profiles, user: Some(&user), script: None };
    Ok(frame.answer(html! {
        div.head {
            div { h1 { "Profiles" } p.soft { "A profile describes how each slice of a rig and lens is laid onto the reference slice." } }
            @if user.profiles { a.button.main href=(link!("/send?purpose=calibration")) { "Calibrate" } }
        }
        @if profiles.items.is_empty() {
            div.empty {
                p.lead { "There are no profiles yet." }
                p { a href=(link!("/plan")) { "Print a dot target" } ", photograph it at every rail position, and send the pictures as a calibration." }
            }
        } @else {
            div.wide tabindex="0" role="region" aria-label="Profiles" { table {
                thead { tr {
                    @for head in ["Rig", "Lens"] { th.l scope="col" { (head) } }
                    @for head in ["Revision", "Slices", "Size, px"] { th scope="col" { (head) } }
                    th.l scope="col" { "Written" } th.l scope="col" { "Note" }
                } }
                tbody { @for profile in &profiles.items { tr {
                    td.l { a href=(link!("/profiles/{}/{}", profile.rig, profile.lens)) { (profile.rig) } }
                    td.l { (profile.lens) }
                    td { (profile.revision) } td { (profile.slice_count) }
                    td { (profile.image_width) " × " (profile.image_height) }
                    td.l { (ago(profile.created_at, now)) }
                    td.l { (text(profile.note.as_deref().unwrap_or("–"))) }
                } } }
            } }
        }
        (pager(&link!("/profiles"), &[], is_first, profiles.next_cursor.as_deref()))
        @if !calibrations.items.is_empty() {
            h2 { "Latest calibrations" }
            div.wide tabindex="0" role="region" aria-label="Latest calibrations" { table {
                thead { tr { @for head in ["Calibration", "Rig and lens", "State", "Sent", "Remarks"] { th.l scope="col" { (head) } } } }
                tbody { @for job in &calibrations.items { tr {
                    td.l { a href=(link!("/calibrations/{}", job.id)) { (text(&name(job))) } }
                    td.l { (job.rig) " · " (job.lens) }
                    td.l { (state(job.state)) }
                    td.l { (ago(job.created_at, now)) }
                    td.l { @if let Some(error) = &job.error { span.bad { (sentence(&error.detail)) } } }
                } } }
            } }
        }
    }))
}
