//! `POST /v1/stacks/{id}/rerun`

use axum::{body::Body, extract::State, http::HeaderMap, response::Response};
use serde_json::{Map, Value};

use super::upload::removed;
use crate::{
    contract::{
        Code, JobKind,
        options::StackOptions,
        profile::Profile,
        request::{JobRequest, StackRequest},
    },
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::{JobId, Sent, json},
        ingest::{
            admission::require_admissible,
            receivable::Receivable,
            request::IngestRequest,
            spool::SpooledZip,
            submission::{Submission, stack::StackSubmission},
        },
        job_resource::{load, not_found},
        profiles, scans,
        views::Stack,
    },
    store::Job,
};

/// Name of the option that chooses the revision of the profile.
const REVISION: &str = "profile_revision";

/// Fuse a stack again
///
/// Makes a new stack from the stored zip of this one, with other options or another revision of the profile. This stack
/// does not change; it may be in any state. Both stacks share the zip on the disk, and deleting one keeps it for the
/// other. Each counts in full towards the quota of a token.
///
/// The body is a JSON object of options, or empty. An option in the body replaces that of this stack; null resets it to
/// its default; an option that is absent is kept (`label`, `scan`, `pan_deg` and `tilt_deg` included). Without
/// `profile_revision` the new stack uses the revision of this stack, even if the profile was deleted meanwhile; null
/// means the current revision. The new submission is checked like any other.
#[utoipa::path(
    post,
    path = "/v1/stacks/{id}/rerun",
    operation_id = "rerun_stack",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the new stack of the first"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 50) for the job to end"),
    ),
    request_body(content = ref("#/components/schemas/RerunOptions"), content_type = "application/json", description = "The options to change; empty: none"),
    responses(
        (status = 200, description = "The new stack has ended within the time of `Prefer: wait`", body = Stack),
        (status = 202, description = "The new stack is accepted (with `Idempotency-Replayed: true`: by an earlier request)", body = Stack, headers(
            ("Location" = String, description = "URL of the new stack"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made the stack"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: an invalid option, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`not_found`: no such stack; `profile_not_found`: no such revision"),
        (status = 410, description = "`upload_removed`: the zip was removed at the end of its retention period"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB, or storing the zip takes longer than 50 minutes, which only a resumable upload may take"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`size_mismatch`, `slice_count_mismatch`: the zip does not match the other revision; `mask_failed` (required without a back light); \
            `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`: the limits of the server were lowered; `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn rerun(State(app): State<App>, caller: Caller, JobId(id): JobId, sent: Sent) -> ApiResult<Response> {
    sent.refuse_query("the options are members of the JSON body")?;
    let changes = changes(&app, &sent.headers, sent.body).await?;
    let first = load(&app, id, JobKind::Stack).await?;
    let JobRequest::Stack(stored) = &first.request else { return Err(not_found(id, JobKind::Stack)) };
    let submission = submission(&app, &caller, &first, stored, changes).await?;
    if first.upload_removed {
        return Err(removed());
    }
    let request = IngestRequest::begin(&app, &caller, &sent.headers).await?;
    if !request.key.is_repeat {
        // a local zip is shared by a hard link; space for the copy of one in a bucket is reserved when it is made
        require_admissible(&app, &caller, 0, submission.disk_need(0)).await?;
    }
    let zip = stored_zip(&app, &first).await?;
    let stack = request.submit(submission, zip).await?;
    request.answer(stack).await
}

/// The submission of a stack that is fused again with changed options.
///
/// # Errors
/// `invalid_request` for an invalid option; `profile_not_found`; `scan_not_found`; `scan_mismatch`.
pub async fn submission(
    app: &App,
    caller: &Caller,
    first: &Job,
    stored: &StackRequest,
    changes: Map<String, Value>,
) -> ApiResult<Submission> {
    let (options, profile) = changed(app, first, stored, changes).await?;
    if let Some(scan) = &options.scan {
        scans::require_joinable(app, caller, scan, &first.rig, &first.lens).await?;
    }
    Ok(Submission::Stack(Box::new(StackSubmission::new(profile, options, Some(first.id))?)))
}

/// The stored zip of a stack.
///
/// # Errors
/// `upload_removed`.
pub async fn stored_zip(app: &App, stack: &Job) -> ApiResult<SpooledZip> {
    if let Some(zip) = SpooledZip::of_stored(app, stack.request.upload()).await? {
        return Ok(zip);
    }
    // removed since the row was read: the row now says why
    let now = load(app, stack.id, JobKind::Stack).await?;
    Err(if now.upload_removed { removed() } else { ApiError::internal("the zip of a stack is missing") })
}

/// The members of the body.
///
/// # Errors
/// `unsupported_media_type`, `upload_too_large`, `invalid_request`.
pub async fn changes(app: &App, headers: &HeaderMap, body: Body) -> ApiResult<Map<String, Value>> {
    json::require_json(headers)?;
    let bytes = json::read(app, headers, body).await?;
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Ok(Map::new());
    }
    Ok(json::parse(&bytes, Code::InvalidRequest)?)
}

/// The options of the new stack, and the revision that it uses.
async fn changed(
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
        // the revision of the first stack may be used again even if it was deleted meanwhile
        Some(revision) if revision == request.profile_revision => {
            app.store.metadata.profile_of_job(rig, lens, revision).await?
        }
        _ => None,
    };
    let profile = match profile {
        Some(profile) => profile,
        None => profiles::find(app, rig, lens, options.profile_revision).await?,
    };
    Ok((options, profile))
}

/// The options of a stack with changes applied; null resets an option to its default.
fn merged(options: &StackOptions, changes: Map<String, Value>) -> ApiResult<StackOptions> {
    let Ok(Value::Object(mut members)) = serde_json::to_value(options) else {
        return Err(ApiError::internal("the options of a stack are not a JSON object"));
    };
    for (name, value) in changes {
        // a null under an unknown name stays, so that the name is refused
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
    fn named_options_are_replaced_null_resets_and_the_rest_is_kept() {
        let options = with(json!({ "r2": 9, "label": null, "format": null })).expect("all of them are valid");
        assert_eq!((options.r1, options.r2, options.label), (20, 9, None));
        assert_eq!(options.format, ImageFormat::Png);
    }

    #[test]
    fn unknown_options_and_wrong_types_are_refused() {
        assert!(with(json!({ "radius": 1 })).unwrap_err().contains("radius"));
        assert!(with(json!({ "radius": null })).unwrap_err().contains("radius"));
        assert!(with(json!({ "r1": "many" })).unwrap_err().starts_with("/r1"));
    }
}
