//! `POST /v1/stacks/{id}/rerun`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde_json::{Map, Value};

use super::order::StackOrder;
use crate::{
    contract::{
        Code, JobKind,
        options::StackOptions,
        profile::Profile,
        request::{JobRequest, StackRequest},
    },
    http::{
        auth::Caller,
        extract::{JobId, json, params},
        intake::{
            accept::complete, admission::require_place, idempotency, order::Order, reservation::require_room,
            spool::Spooled,
        },
        problem::{ApiError, ApiResult},
        profiles::not_found,
        state::App,
        views::Stack,
        watch::load::load,
    },
    store::Job,
};

/// Name of the option that says which revision is used.
const REVISION: &str = "profile_revision";

/// Fuse a stack again
///
/// Makes a new stack from the zip of this one, with other options or another revision of the profile, without sending the
/// zip again. This stack stays as it is, in whatever state it is. The two share the zip on the disk; deleting one leaves
/// it to the other. Against the quota of a token each of them counts in full.
///
/// The body is a JSON object of options, or nothing. An option that it names replaces that of this stack, one that is null
/// gets its default, and one that it does not name stays as it was (`label`, `scan`, `pan_deg` and `tilt_deg`, too).
/// Without `profile_revision` the new stack uses the revision that this one used, even when the profile was deleted; null is
/// the current revision. What is checked when a stack is sent is checked here too.
#[utoipa::path(
    post,
    path = "/v1/stacks/{id}/rerun",
    operation_id = "rerun_stack",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Idempotency-Key" = Option<String>, Header, description = "A repeat with the same key answers the first new stack"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds for the end, at most 60"),
    ),
    request_body(content = ref("#/components/schemas/RerunOptions"), content_type = "application/json", description = "What is different; nothing: the same again"),
    responses(
        (status = 200, description = "The new stack has ended within `Prefer: wait`", body = Stack),
        (status = 202, description = "The new stack is accepted (or was before: `Idempotency-Replayed: true`)", body = Stack, headers(
            ("Location" = String, description = "The new stack"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made it"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: an option that breaks its rule, or a body that is not JSON; `upload_incomplete`"),
        (status = 404, description = "`not_found`: no such stack; `profile_not_found`: no such revision"),
        (status = 410, description = "`upload_removed`: the zip is gone, because its time was over"),
        (status = 413, description = "`upload_too_large`: over 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`size_mismatch`, `slice_count_mismatch`: the zip does not fit the other revision; `mask_failed` (required without a back light), \
            `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`: the limits of the server are lower now; `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn rerun(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    params::refuse_rest(&params::pairs(&uri)?, "none; the options are members of the JSON body")?;
    let changes = changes(&app, &headers, body).await?;
    let first = load(&app, id, JobKind::Stack).await?;
    let JobRequest::Stack(request) = &first.request else { return Err(ApiError::internal("a stack is no stack")) };
    let (options, profile) = asked(&app, &first, request, changes).await?;
    let order = StackOrder::new(profile, options, Some(id))?;
    if first.upload_removed {
        return Err(removed());
    }
    let key = idempotency::key(&headers)?.map(|key| idempotency::of_caller(key, caller.sees_only(&app)));
    let is_repeat = match &key {
        Some(key) => app.rows.by_idempotency_key(key).await?.is_some(),
        None => false,
    };
    if !is_repeat {
        require_place(&app).await?;
        // the zip takes no more room than it has
        require_room(&app, 0, order.disk_need()).await?;
    }
    let Some(file) = Spooled::of_stored(&app, &request.upload).await? else {
        // removed since the row was read: the row says by now what became of it
        let now = load(&app, id, JobKind::Stack).await?;
        return Err(if now.upload_removed { removed() } else { ApiError::internal("the zip of a stack is missing") });
    };
    complete(&app, &caller, &headers, order, file, key, Stack::of).await
}

/// The zip of a stack is gone, and was meant to go.
pub fn removed() -> ApiError {
    let detail = "the zip of this stack was removed because its time was over (keep_uploads_days of the server); its results \
                  are there; send the zip again for another result";
    ApiError::new(Code::UploadRemoved, detail)
}

/// What the body names.
async fn changes(app: &App, headers: &HeaderMap, body: Body) -> ApiResult<Map<String, Value>> {
    json::require_json(headers)?;
    let bytes = json::read(app, headers, body).await?;
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Ok(Map::new());
    }
    Ok(json::parse(&bytes, Code::InvalidRequest)?)
}

/// The options of the new stack, and the revision that it uses.
async fn asked(
    app: &App,
    first: &Job,
    request: &StackRequest,
    changes: Map<String, Value>,
) -> ApiResult<(StackOptions, Profile)> {
    let names_revision = changes.contains_key(REVISION);
    let mut options = merged(&request.options, changes)?;
    if !names_revision {
        options.profile_revision = Some(request.profile_revision);
    }
    let Job { rig, lens, .. } = first;
    let profile = match options.profile_revision {
        // what the stack used may be used again, also when it was deleted since
        Some(revision) if revision == request.profile_revision => app.rows.profile_of_job(rig, lens, revision).await?,
        revision => app.rows.profile(rig, lens, revision).await?,
    };
    let Some(profile) = profile else { return Err(not_found(app, rig, lens, options.profile_revision).await) };
    Ok((options, profile))
}

/// The options of a stack with changes: null stands for the default.
fn merged(options: &StackOptions, changes: Map<String, Value>) -> ApiResult<StackOptions> {
    let Ok(Value::Object(mut members)) = serde_json::to_value(options) else {
        return Err(ApiError::internal("the options of a stack are no object"));
    };
    for (name, value) in changes {
        // a null of an unknown name stays, to be refused with it
        if value.is_null() && members.remove(&name).is_some() {
            continue;
        }
        members.insert(name, value);
    }
    let document = serde_json::to_vec(&members).map_err(ApiError::internal)?;
    Ok(json::parse(&document, Code::InvalidRequest)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::options::ImageFormat;
    use serde_json::json;

    fn with(changes: Value) -> Result<StackOptions, String> {
        let base = StackOptions { r1: 20, label: Some("bee".into()), format: ImageFormat::Tiff, ..Default::default() };
        let Value::Object(changes) = changes else { panic!("a test gives an object") };
        merged(&base, changes).map_err(|error| error.fault().detail.clone())
    }

    #[test]
    fn what_is_named_replaces_null_is_the_default_and_the_rest_stays() {
        let options = with(json!({ "r2": 9, "label": null, "format": null })).expect("all of them are valid");
        assert_eq!((options.r1, options.r2, options.label), (20, 9, None));
        assert_eq!(options.format, ImageFormat::Png);
    }

    #[test]
    fn what_is_unknown_or_of_another_type_is_refused() {
        assert!(with(json!({ "radius": 1 })).unwrap_err().contains("radius"));
        assert!(with(json!({ "radius": null })).unwrap_err().contains("radius"));
        assert!(with(json!({ "r1": "many" })).unwrap_err().starts_with("/r1"));
    }
}
