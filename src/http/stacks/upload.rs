//! `GET /v1/stacks/{id}/upload`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderName, HeaderValue, header},
    response::Response,
};
use base64::{Engine, prelude::BASE64_STANDARD};
use uuid::Uuid;

use crate::{
    contract::{Code, JobKind},
    http::{
        ApiError, ApiResult, App,
        artifacts::{
            download::{Download, content},
            name,
            redirect::MayRedirect,
        },
        extract::JobId,
        job_resource::load,
    },
};

/// Digest of the whole file (RFC 9530).
const REPR_DIGEST: HeaderName = HeaderName::from_static("repr-digest");

/// Download the zip of a stack
///
/// The zip as it was sent, under its original file name. For a rerun, the zip that it shares with the first stack.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/upload",
    operation_id = "get_stack_upload",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("redirect" = Option<bool>, Query, description = "The client follows a redirect to the bucket of the service"),
        ("Range" = Option<String>, Header, description = "One byte range"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: send the range only if the file still has this tag, otherwise the whole file"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
    ),
    responses(
        (status = 200, description = "The zip", body = Vec<u8>, content_type = "application/zip", headers(
            ("ETag" = String, description = "SHA-256 of the zip, hex"),
            ("Repr-Digest" = String, description = "SHA-256 of the whole zip, base64 (RFC 9530)"),
            ("Content-Disposition" = String, description = "The file name that the client gave, or one made from the id"))),
        (status = 206, description = "The requested range"),
        (status = 307, description = "With `redirect=true`, if the service signs URLs of its bucket: the zip at `Location`, until the URL expires", headers(
            ("Location" = String, description = "A signed URL; send no token to it"))),
        (status = 304, description = "The copy of the client is current"),
        (status = 400, description = "`invalid_request`: `redirect` is neither `true` nor `false`, or is given twice"),
        (status = 404, description = "`not_found`"),
        (status = 410, description = "`upload_removed`: the zip was removed at the end of its retention period; the results are kept"),
        (status = 412, description = "`precondition_failed`: the zip does not have the tag in `If-Match`"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn upload(
    State(app): State<App>,
    JobId(id): JobId,
    redirect: MayRedirect,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    let stored = job.request.upload();
    if job.upload_removed {
        return Err(removed());
    }
    let content = match content(&app, &stored.key).await? {
        Some(content) => content,
        None => return Err(missing(&app, id, &stored.key).await),
    };
    let name = name::of_upload(&job);
    let tag = stored.sha256.clone();
    let download =
        Download { content: Some(content), tag, media_type: "application/zip".to_owned(), name: name.clone() };
    if let Some(redirect) = redirect.answer(&app, &download, &name::attachment(&name), &headers).await? {
        return Ok(redirect);
    }
    let mut response = download.answer(&headers).await?;
    let out = response.headers_mut();
    if out.contains_key(header::CONTENT_DISPOSITION) {
        out.insert(header::CONTENT_DISPOSITION, name::attachment(&name));
    }
    if let Some(digest) = digest(&stored.sha256) {
        out.insert(REPR_DIGEST, digest);
    }
    Ok(response)
}

/// The error for a zip that was removed at the end of its retention period.
pub fn removed() -> ApiError {
    let detail = "the zip of this stack was removed at the end of its retention period (keep_uploads_days of the server); \
                  its results are kept; send the zip again to fuse it with other options";
    ApiError::new(Code::UploadRemoved, detail)
}

/// The error for a zip that is not there: the stack was deleted since its row was read, or the zip was lost.
async fn missing(app: &App, id: Uuid, key: &str) -> ApiError {
    match app.store.metadata.job(id).await {
        Ok(Some(job)) if !job.upload_removed => {
            tracing::error!(key, "the stored zip of a stack is missing; `pinstack verify` lists all missing files");
            let detail = "the stored zip of the stack is missing; send the zip again, and ask the operator to run \
                          `pinstack verify`";
            ApiError::new(Code::Internal, detail)
        }
        Ok(Some(_)) => removed(),
        Ok(None) => ApiError::new(Code::NotFound, "the stack was deleted"),
        Err(error) => error.into(),
    }
}

/// The value of `Repr-Digest` for a SHA-256 in hex.
fn digest(sha256: &str) -> Option<HeaderValue> {
    let byte = |at: usize| u8::from_str_radix(sha256.get(at..at + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..sha256.len()).step_by(2).map(byte).collect();
    HeaderValue::from_str(&format!("sha-256=:{}:", BASE64_STANDARD.encode(bytes?))).ok()
}
