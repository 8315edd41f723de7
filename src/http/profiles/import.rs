//! `POST /v1/profiles/{rig}/{lens}/import`

use axum::{extract::State, response::Response};

use super::{file::ProfileFile, write};
use crate::{
    contract::profile::Profile,
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey, Sent, json},
    },
    store::ProfileDraft,
};

/// Import a profile
///
/// Stores a file from `.../export`, of this server or another, as the next revision under the rig and lens of this URL.
/// All data of the exported revision is kept, and `origin` records where it comes from. A file that was changed after
/// its export is refused. If the current revision is identical, it is returned and no revision is stored. `PUT` is
/// equivalent, for `curl -T`.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/import",
    operation_id = "import_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig here"),
        ("lens" = String, Path, description = "Name of the lens here"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the current revision; the request fails if the profile has changed"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only if the profile does not exist yet"),
    ),
    request_body(content = ProfileFile, content_type = "application/json"),
    responses(
        (status = 200, description = "A new revision, or the current one if it is identical", body = Profile, headers(
            ("ETag" = String, description = "The revision number"))),
        (status = 201, description = "The profile was created, at revision 1", body = Profile, headers(
            ("ETag" = String, description = "The revision number"), ("Location" = String, description = "URL of the profile"))),
        (status = 400, description = "`invalid_request`: an invalid name, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out"),
        (status = 412, description = "`precondition_failed`: the profile was changed in the meantime; read it again and retry"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: not an exported profile, another version of the format, or a file that was changed after its export"),
    )
)]
pub async fn import(State(app): State<App>, key: Conditional<ProfileKey>, sent: Sent) -> ApiResult<Response> {
    json::require_json(&sent.headers)?;
    sent.refuse_query("the file contains all data")?;
    let condition = key.precondition(&app).await?;
    let draft = ProfileFile::read(&json::read(&app, &sent.headers, sent.body).await?)?.draft();
    if let Some(current) = app.store.metadata.profile(&key.of.rig, &key.of.lens, None).await?
        && is_identical(&current, &draft)
    {
        return match condition.holds(Some(current.revision)) {
            true => Ok(key.written(false, current.revision, &current)),
            false => Err(key.failed(Some(current.revision))),
        };
    }
    write::store(&app, &key, &draft, condition).await
}

/// True when a new revision would add nothing. The digest is not enough: a note or rail positions may have been added
/// to the same homographies.
fn is_identical(current: &Profile, draft: &ProfileDraft) -> bool {
    current.input == draft.input
        && current.slices == draft.slices
        && current.source == draft.source
        && current.model == draft.model
        && current.warnings == draft.warnings
}
