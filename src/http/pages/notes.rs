//! What people wrote about a stack, a scan or a profile, and the form that adds to it.

use jiff::Timestamp;
use maud::{Markup, html};

use super::{
    assets,
    words::{ago, text},
};
use crate::{
    contract::note::{MAX_CHARACTERS, MAX_NOTES},
    http::{App, auth::Caller, notes::may_delete},
    store::{StoreResult, notes::Subject},
};

/// The section of a page: the notes, and for a person who may write the form.
///
/// # Errors
/// When the store cannot be read.
pub async fn section(app: &App, caller: &Caller, subject: &Subject, may_write: bool) -> StoreResult<Markup> {
    let notes = app.store.metadata.notes(subject).await?;
    let now = Timestamp::now();
    let url = match subject {
        Subject::Stack(id) => link!("/v1/stacks/{id}/notes"),
        Subject::Scan(scan) => link!("/v1/scans/{scan}/notes"),
        Subject::Profile(rig, lens) => link!("/v1/profiles/{rig}/{lens}/notes"),
    };
    Ok(html! {
        section id="notes" data-url=(url) {
            h2 { "Notes by people" }
            @if notes.is_empty() { p.soft { "There are none." } }
            ul.findings {
                @for note in &notes {
                    li {
                        @for line in note.text.lines() { p { (text(line)) } }
                        p.small.soft {
                            @if let Some(author) = &note.author { (author) ", " } (ago(note.created_at, now))
                            @if may_write && may_delete(caller, note) {
                                " " button.quiet type="button" data-note=(note.id) { "Delete this note" }
                            }
                        }
                    }
                }
            }
            @if may_write && notes.len() < MAX_NOTES {
                form {
                    p { label for="note" { "A note for everyone who sees this page" } }
                    textarea id="note" name="note" rows="3" cols="60" required maxlength=(MAX_CHARACTERS) {}
                    div.buttons { button type="submit" { "Add the note" } }
                }
            }
            p id="notes-told" role="alert" {}
            @if may_write { script type="module" src=(assets::url("notes.js")) {} }
        }
    })
}
