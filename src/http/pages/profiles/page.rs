//! `/profiles/{rig}/{lens}`: the current profile, its revisions with their reports, the drift between them, and export.

use axum::{extract::State, response::Response};
use maud::{Markup, html};

use super::{camera, drift_plot};
use crate::{
    contract::{ProfileSummary, profile::Profile},
    http::{
        ApiResult, App,
        auth::Caller,
        extract::ProfileKey,
        pages::{
            frame::{Frame, PageUser, Place},
            notes,
            words::{date, sentence, text},
        },
        profiles::find,
    },
    store::{PageRequest, notes::Subject},
};

/// Revisions on the page.
const ROWS: u32 = 50;

/// The page.
///
/// # Errors
/// `profile_not_found`.
pub async fn page(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    ProfileKey { rig, lens }: ProfileKey,
) -> ApiResult<Response> {
    let profile = find(&app, &rig, &lens, None).await?;
    let revisions = app.store.metadata.revisions(&rig, &lens, &PageRequest { limit: ROWS, cursor: None }).await?;
    let numbers: Vec<u32> = revisions.items.iter().map(|revision| revision.revision).collect();
    let drift = drift_plot::plot(&app, &rig, &lens, &numbers).await?;
    let title = format!("{rig} · {lens}");
    let export = link!("/v1/profiles/{rig}/{lens}/export");
    let notes = notes::section(&app, &caller, &Subject::Profile(rig.clone(), lens.clone()), user.profiles).await?;
    let frame = Frame { title: &title, place: Place::Profiles, user: Some(&user), script: Some("profile.js") };
    Ok(frame.answer(html! {
        div.head {
            div { p.crumbs { a href=(link!("/profiles")) { "Profiles" } } h1 { (title) } }
            div.buttons {
                a.button href=(link!("/stacks?rig={rig}&lens={lens}")) { "Its stacks" }
                a.button href=(export) download { "Export" }
                a.button href={ (export) "?format=npz" } download { "Arrays (npz)" }
            }
        }
        (facts(&profile))
        (camera::section(&profile.input, &rig, &lens, user.profiles))
        (drift)
        (notes)
        h2 { "Revisions" }
        p.soft { "A revision never changes. Each stack names the one that it used." }
        (table(&revisions.items, &export))
        @if revisions.next_cursor.is_some() { p.soft { "The latest " (ROWS) " are shown." } }
    }))
}

fn facts(profile: &Profile) -> Markup {
    let input = &profile.input;
    html! {
        @if !profile.warnings.is_empty() {
            ul.warnings { @for warning in &profile.warnings { li { (sentence(&warning.detail)) } } }
        }
        dl.facts {
            dt { "Revision" } dd { (profile.revision) ", " (date(profile.created_at)) " UTC" }
            dt { "Slices" } dd { (input.homographies.len()) ", numbered from 0; the reference is slice " (input.reference_index) }
            dt { "Size" } dd { (input.image_width) " × " (input.image_height) " px" }
            @if let Some(note) = &input.note { dt { "Note" } dd { (text(note)) } }
        }
    }
}

fn table(revisions: &[ProfileSummary], export: &str) -> Markup {
    html! {
        div.wide tabindex="0" role="region" aria-label="Revisions" { table {
            thead { tr {
                th scope="col" { "Revision" } th.l scope="col" { "Written" } th scope="col" { "Slices" }
                th.l scope="col" { "Source" } th.l scope="col" { "Note" } th.l scope="col" { "File" }
            } }
            tbody { @for revision in revisions { tr {
                td { (revision.revision) }
                td.l { (date(revision.created_at)) }
                td { (revision.slice_count) }
                td.l {
                    @match revision.calibration_id {
                        Some(id) => { a href=(link!("/v1/calibrations/{id}/report")) { "calibration report" } }
                        None => { "uploaded numbers" }
                    }
                }
                td.l { (text(revision.note.as_deref().unwrap_or("–"))) }
                td.l { a href={ (export) "?revision=" (revision.revision) } download aria-label={ "JSON of revision " (revision.revision) } { "JSON" } }
            } } }
        } }
    }
}
