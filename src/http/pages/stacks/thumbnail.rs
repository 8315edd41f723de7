//! `GET /stacks/{id}/thumbnail`: the picture of a stack in a list, a JPEG of a few kB, made of the preview when it is
//! first asked for. Its URL contains its digest, so browsers keep it.

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use maud::{Markup, html};
use uuid::Uuid;

use crate::{
    contract::{JobKind, artifact::StackArtifact},
    http::{
        ApiResult, App,
        artifacts::{download, outcome},
        extract::{JobId, etag, not_modified},
        job_resource::load,
    },
    store::Job,
};

/// The endpoint.
///
/// # Errors
/// `not_found`; `not_finished` and `no_result` without a preview.
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    let preview = outcome::artifact(&job, StackArtifact::Preview.name())?;
    let tag = format!("{}-thumbnail", preview.sha256);
    let keep = HeaderValue::from_static("private, max-age=604800, immutable");
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, keep)];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    let jpeg = app.thumbnails.get(&preview.sha256, download::bytes(&app, &job, preview)).await?;
    Ok((common, [(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response())
}

/// URL of the thumbnail of a stack; `digest` is that of its preview.
pub fn url(id: Uuid, digest: &str) -> String {
    link!("/stacks/{id}/thumbnail?v={}", digest.get(..12).unwrap_or(digest))
}

/// The picture of a stack in a list, or a sign for its absence. The name beside it says what it is.
pub fn picture(job: &Job) -> Markup {
    let artifacts = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
    let preview = StackArtifact::Preview.among(artifacts);
    html! {
        span.thumb {
            @match preview {
                Some(preview) => { img src=(url(job.id, &preview.sha256)) alt="" loading="lazy" width="96" height="68"; }
                None => { span.soft aria-hidden="true" { @if job.state.is_final() { "–" } @else { "…" } } }
            }
        }
    }
}
