//! `GET /v1/stacks/{id}/upload`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderName, HeaderValue, header},
    response::Response,
};
use base64::{Engine, prelude::BASE64_STANDARD};

use super::rerun::removed;
use crate::{
    contract::{Code, JobKind},
    http::{
        artifacts::{
            download::{Content, Download, open},
            name,
        },
        extract::JobId,
        problem::{ApiError, ApiResult},
        state::App,
        watch::load::load,
    },
};

/// Digest of the whole file (RFC 9530).
const REPR_DIGEST: HeaderName = HeaderName::from_static("repr-digest");

/// Download the zip of a stack
///
/// The zip as it was sent, under the name that it had then. Of a rerun: the zip that it shares with the first stack.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/upload",
    operation_id = "get_stack_upload",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Range" = Option<String>, Header, description = "One range of bytes"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: the range only if it is still that file"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of what the client has"),
    ),
    responses(
        (status = 200, description = "The zip", body = Vec<u8>, content_type = "application/zip", headers(
            ("ETag" = String, description = "SHA-256 of the zip, hex"),
            ("Repr-Digest" = String, description = "SHA-256 of the whole zip, base64 (RFC 9530)"),
            ("Content-Disposition" = String, description = "The name that the client gave, or one made of the id"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`"),
        (status = 410, description = "`upload_removed`: its time was over; the results are there"),
        (status = 412, description = "`precondition_failed`: the zip is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn upload(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    let stored = job.request.upload();
    if job.upload_removed {
        return Err(removed());
    }
    let gone = || ApiError::new(Code::NotFound, "the stack was deleted");
    let (file, length) = open(&app, &stored.key).await?.ok_or_else(gone)?;
    let name = name::of_upload(&job);
    let tag = stored.sha256.clone();
    let download = Download {
        content: Some(Content { file, length }),
        tag,
        media_type: "application/zip".to_owned(),
        name: name.clone(),
    };
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

/// The header's value for a digest in hex.
fn digest(sha256: &str) -> Option<HeaderValue> {
    let byte = |at: usize| u8::from_str_radix(sha256.get(at..at + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..sha256.len()).step_by(2).map(byte).collect();
    HeaderValue::from_str(&format!("sha-256=:{}:", BASE64_STANDARD.encode(bytes?))).ok()
}
