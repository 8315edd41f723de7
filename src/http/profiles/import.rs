//! `POST /v1/profiles/{rig}/{lens}/import`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, StatusCode, Uri},
    response::Response,
};

use super::{file::ProfileFile, lost_race, precondition, write};
use crate::{
    contract::profile::Profile,
    http::{
        extract::{ProfileKey, json, params},
        problem::ApiResult,
        state::App,
    },
    store::ProfileDraft,
};

/// Import a profile
///
/// Takes a file that `.../export` gave, of this server or another. It becomes the next revision, under the names of this
/// URL, with everything that was known about it; `origin` says where it comes from. A file that was changed is refused.
/// When the current revision says the same already, that one is the answer and none is made. PUT (`curl -T`) works too.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/import",
    operation_id = "import_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig here"),
        ("lens" = String, Path, description = "Name of the lens here"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the revision that this one replaces"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only when there is no profile yet"),
    ),
    request_body(content = ProfileFile, content_type = "application/json"),
    responses(
        (status = 200, description = "A new revision, or the current one when it says the same already", body = Profile, headers(
            ("ETag" = String, description = "The revision"))),
        (status = 201, description = "The first revision", body = Profile, headers(
            ("ETag" = String, description = "The revision"), ("Location" = String, description = "The profile"))),
        (status = 400, description = "`invalid_request`: a name that breaks its rule, or a body that is not JSON; `upload_incomplete`"),
        (status = 412, description = "`precondition_failed`: somebody else was faster"),
        (status = 413, description = "`upload_too_large`: over 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: no exported profile, one of another version, or one that was changed after it was exported"),
    )
)]
pub async fn import(
    State(app): State<App>,
    key: ProfileKey,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    json::require_json(&headers)?;
    params::refuse_rest(&params::pairs(&uri)?, "none, everything is in the file")?;
    let condition = precondition(&app, &key, &headers).await?;
    let draft = ProfileFile::read(&json::read(&app, &headers, body).await?)?.draft();
    if let Some(current) = app.store.metadata.profile(&key.rig, &key.lens, None).await?
        && says_the_same(&current, &draft)
    {
        return match condition.holds(Some(current.revision)) {
            true => Ok(write::written(&key, StatusCode::OK, &current)),
            false => Err(lost_race(&key, Some(current.revision), &write::demanding(condition))),
        };
    }
    write::store(&app, &key, &draft, condition).await
}

/// True when a new revision would tell nothing new. More than the digest counts: a note or rail positions may have been
/// added to the same homographies.
fn says_the_same(current: &Profile, draft: &ProfileDraft) -> bool {
    current.input == draft.input
        && current.slices == draft.slices
        && current.source == draft.source
        && current.model == draft.model
        && current.warnings == draft.warnings
}
