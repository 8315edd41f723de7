//! Notes about stacks, scans and profiles: `GET` and `POST .../notes`, `DELETE .../notes/{note}`. One macro documents
//! the endpoints of the three; the functions below do the work.

use axum::{
    Json,
    http::{StatusCode, header::HeaderValue},
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use utoipa::ToSchema;
use uuid::{Builder, Uuid};

use super::{
    ApiError, ApiResult, App,
    auth::Caller,
    extract::{JobId, ProfileKey, Sent, json},
    ingest::idempotency::{self, IDEMPOTENCY_REPLAYED},
    job_resource, profiles as of_profiles, scans as of_scans,
};
use crate::{
    contract::{
        Code, JobKind, Note,
        note::{MAX_NOTES, NoteInput},
    },
    store::notes::{AddNote, NewNote, Subject},
};

/// The notes about an object, the oldest first.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct NoteList {
    /// All of them: at most 100.
    pub items: Vec<Note>,
}

/// What notes can be about, as a URL names it.
pub trait Noted {
    /// It, if it exists and the caller may see it.
    ///
    /// # Errors
    /// `not_found`, `scan_not_found`, `profile_not_found`.
    fn subject(self, app: &App, caller: &Caller) -> impl Future<Output = ApiResult<Subject>> + Send;
}

impl Noted for JobId {
    // of another token, where tokens see only their own: `middleware::auth` has refused it
    async fn subject(self, app: &App, _: &Caller) -> ApiResult<Subject> {
        job_resource::load(app, self.0, JobKind::Stack).await.map(|stack| Subject::Stack(stack.id))
    }
}

impl Noted for of_scans::ScanName {
    async fn subject(self, app: &App, caller: &Caller) -> ApiResult<Subject> {
        of_scans::find(app, caller, &self.0).await.map(|scan| Subject::Scan(scan.name))
    }
}

impl Noted for ProfileKey {
    async fn subject(self, app: &App, _: &Caller) -> ApiResult<Subject> {
        let profile = of_profiles::find(app, &self.rig, &self.lens, None).await?;
        Ok(Subject::Profile(profile.rig, profile.lens))
    }
}

/// Whether the caller may delete a note: its author, an admin, and everyone where no token is required. A note without
/// an author may be deleted by all who may write notes.
pub fn may_delete(caller: &Caller, note: &Note) -> bool {
    note.author.is_none() || caller.name() == note.author.as_ref() || caller.token().is_none_or(|of| of.allows(&[]))
}

async fn list(app: &App, caller: &Caller, of: impl Noted) -> ApiResult<Json<NoteList>> {
    let subject = of.subject(app, caller).await?;
    Ok(Json(NoteList { items: app.store.metadata.notes(&subject).await? }))
}

async fn add(app: &App, caller: &Caller, of: impl Noted, sent: Sent) -> ApiResult<Response> {
    json::require_json(&sent.headers)?;
    sent.refuse_query("the text is a member of the JSON body")?;
    let key = idempotency::parse(&sent.headers)?;
    let input: NoteInput = json::parse(&json::read(app, &sent.headers, sent.body).await?, Code::InvalidRequest)?;
    let text = input.checked()?;
    let subject = of.subject(app, caller).await?;
    let id = key.map_or_else(Uuid::now_v7, |key| id_of_key(caller, &subject, &key));
    let note = NewNote { id, text, author: caller.name().cloned() };
    let refused = |code, detail: &str| Err(ApiError::new(code, detail));
    match app.store.metadata.add_note(&subject, &note, MAX_NOTES).await? {
        AddNote::Added(added) => Ok((StatusCode::CREATED, Json(added)).into_response()),
        AddNote::Repeated(first) if first.text == note.text => {
            let replayed = [(IDEMPOTENCY_REPLAYED, HeaderValue::from_static("true"))];
            Ok((StatusCode::CREATED, replayed, Json(first)).into_response())
        }
        AddNote::Repeated(_) => refused(
            Code::IdempotencyKeyReused,
            "the Idempotency-Key was used before with another text; use a new key per note",
        ),
        AddNote::Full => refused(Code::Conflict, "there are 100 notes, which is the most; delete one first"),
        AddNote::NoSubject => refused(Code::NotFound, "what the note is about was deleted in the meantime"),
    }
}

/// The id of the note that a caller writes with this `Idempotency-Key`.
fn id_of_key(caller: &Caller, subject: &Subject, key: &str) -> Uuid {
    let digest = Sha256::digest(format!("{:?} {subject:?} {key}", caller.id()));
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    Builder::from_custom_bytes(bytes).into_uuid()
}

async fn delete(app: &App, caller: &Caller, of: impl Noted, id: Uuid) -> ApiResult<StatusCode> {
    let subject = of.subject(app, caller).await?;
    let notes = app.store.metadata.notes(&subject).await?;
    let Some(note) = notes.iter().find(|note| note.id == id) else {
        return Err(ApiError::new(Code::NotFound, format!("there is no note {id}")));
    };
    if !may_delete(caller, note) {
        let detail =
            "the note was written with another token; its author or a token with the scope admin may delete it";
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    app.store.metadata.delete_note(&subject, id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// The endpoints of a kind of objects: module, extractor, tag, noun, base of the URL, the code for what is missing, the
/// parameters of the path, and the response to an invalid name.
macro_rules! endpoints {
    ($module:ident, $key:ty, $tag:literal, $one:literal, $base:literal, $missing:literal, $(($name:literal, $what:literal)),+; $($invalid:tt)*) => {
        #[doc = concat!("Those of a ", $one, ".")]
        pub mod $module {
            use axum::{Json, extract::State, http::StatusCode, response::Response};

            use super::{Note, NoteInput, NoteList};
            use crate::http::{
                ApiResult, App,
                auth::Caller,
                extract::{Sent, path::NoteId},
            };

            #[doc = concat!("`GET ", $base, "/notes`")]
            #[utoipa::path(
                get,
                path = concat!($base, "/notes"),
                operation_id = concat!("list_", $one, "_notes"),
                tag = $tag,
                summary = concat!("List the notes about a ", $one),
                description = "What people wrote about it, the oldest first.",
                params($(($name = String, Path, description = $what)),+),
                responses(
                    (status = 200, description = "The notes", body = NoteList),
                    $($invalid)*
                    (status = 404, description = $missing),
                ),
            )]
            pub async fn list(State(app): State<App>, caller: Caller, of: $key) -> ApiResult<Json<NoteList>> {
                super::list(&app, &caller, of).await
            }

            #[doc = concat!("`POST ", $base, "/notes`")]
            #[utoipa::path(
                post,
                path = concat!($base, "/notes"),
                operation_id = concat!("add_", $one, "_note"),
                tag = $tag,
                summary = concat!("Write a note about a ", $one),
                description = concat!(
                    "A text of 1 to 2,000 characters, kept with the name of the token and the time. At most 100 notes about \
                     one ", $one, ". They are deleted with it."
                ),
                params(
                    $(($name = String, Path, description = $what)),+,
                    ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the note of the first"),
                ),
                request_body(content = NoteInput, example = json!({ "text": "left antenna broken before the scan" })),
                responses(
                    (status = 201, description = "The note", body = Note, headers(
                        ("Idempotency-Replayed" = String, description = "`true` when an earlier request wrote the note"))),
                    (status = 400, description = "`invalid_request`: not JSON of this structure, or a text that is empty or too long; `upload_incomplete`: the connection closed or timed out"),
                    (status = 404, description = $missing),
                    (status = 409, description = "`conflict`: there are 100 notes"),
                    (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
                    (status = 415, description = "`unsupported_media_type`: not JSON"),
                    (status = 422, description = "`idempotency_key_reused`: with another text"),
                )
            )]
            pub async fn add(State(app): State<App>, caller: Caller, of: $key, sent: Sent) -> ApiResult<Response> {
                super::add(&app, &caller, of, sent).await
            }

            #[doc = concat!("`DELETE ", $base, "/notes/{note}`")]
            #[utoipa::path(
                delete,
                path = concat!($base, "/notes/{note}"),
                operation_id = concat!("delete_", $one, "_note"),
                tag = $tag,
                summary = concat!("Delete a note about a ", $one),
                description = "The token that wrote it and tokens with the scope `admin` may delete it; others are refused (403 `forbidden`).",
                params(
                    $(($name = String, Path, description = $what)),+,
                    ("note" = String, Path, description = "Id of the note"),
                ),
                responses(
                    (status = 204, description = "The note is deleted"),
                    $($invalid)*
                    (status = 404, description = concat!($missing, "; `not_found`: no such note")),
                )
            )]
            pub async fn delete(
                State(app): State<App>,
                caller: Caller,
                of: $key,
                NoteId(note): NoteId,
            ) -> ApiResult<StatusCode> {
                super::delete(&app, &caller, of, note).await
            }
        }
    };
}

endpoints!(
    stacks,
    crate::http::extract::JobId,
    "stacks",
    "stack",
    "/v1/stacks/{id}",
    "`not_found`: no such stack",
    ("id", "Id of the stack");
);
endpoints!(
    scans,
    crate::http::scans::ScanName,
    "scans",
    "scan",
    "/v1/scans/{scan}",
    "`scan_not_found`",
    ("scan", "Name of the scan");
    (status = 400, description = "`invalid_request`: an invalid name"),
);
endpoints!(
    profiles,
    crate::http::extract::ProfileKey,
    "profiles",
    "profile",
    "/v1/profiles/{rig}/{lens}",
    "`profile_not_found`",
    ("rig", "Name of the rig"),
    ("lens", "Name of the lens");
    (status = 400, description = "`invalid_request`: an invalid name"),
);
