//! `GET /stacks/{id}/tiles/{artifact}/{level}/{x}/{y}`: a part of a picture as PNG, at most 512 px a side.
//!
//! The first tile of a picture decodes it, once, into a file with all levels ([`pyramid`]). The same cache that holds
//! converted pictures holds that file: concurrent requests wait for one decoding, pictures are decoded one at a time,
//! disk space is reserved first, and the files that were used longest ago are dropped.

use axum::{
    extract::{Path, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use uuid::Uuid;

use crate::{
    contract::{Code, JobKind, artifact::StackArtifact},
    http::{
        artifacts::{
            conversions::Form,
            download, outcome,
            pyramid::{self, Colours},
        },
        background,
        extract::conditional::{etag, not_modified},
        job_resource::load,
        problem::{ApiError, ApiResult},
        state::App,
    },
};

/// How an artifact is shown; `None` for those without tiles.
pub fn colours(artifact: StackArtifact) -> Option<Colours> {
    match artifact {
        StackArtifact::Image | StackArtifact::Mask | StackArtifact::Backlight => Some(Colours::Plain),
        StackArtifact::Depth => Some(Colours::Indices),
        StackArtifact::Height | StackArtifact::HeightSigma => Some(Colours::Heights),
        StackArtifact::Preview => None,
    }
}

/// The endpoint.
///
/// # Errors
/// `not_found` for a picture or a tile that does not exist; `not_finished`, `no_result`; `insufficient_storage`.
pub async fn get(
    State(app): State<App>,
    Path((id, artifact, level, x, y)): Path<(String, String, String, String, String)>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let none = || ApiError::new(Code::NotFound, "there is no such part of a picture");
    let number = |text: &str| text.parse::<u32>().map_err(|_| none());
    let (level, x, y) = (number(&level)?, number(&x)?, number(&y)?);
    let id = Uuid::parse_str(&id).map_err(|_| none())?;
    let (artifact, colours) =
        StackArtifact::of_name(&artifact).and_then(|a| Some((a, colours(a)?))).ok_or_else(none)?;
    let job = load(&app, id, JobKind::Stack).await?;
    let stored = outcome::artifact(&job, artifact.name())?;
    let tag = format!("{}-tile-{}", stored.sha256, env!("CARGO_PKG_VERSION"));
    let keep = HeaderValue::from_static("private, max-age=604800, immutable");
    let common = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, keep)];
    if not_modified(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, common).into_response());
    }
    if app.conversions.kept(&stored.sha256, Form::Pyramid(colours)).is_none() {
        // refuses a damaged file
        drop(download::stored(&app, &job, stored, String::new()).await?);
    }
    let pyramid = app.conversions.get(&app, &stored.key, &stored.sha256, Form::Pyramid(colours)).await?;
    let _turn = app.tile_permits.acquire().await.map_err(ApiError::internal)?;
    let made = background::spawn_blocking(move || pyramid::tile(pyramid.path(), level, x, y));
    let png = made.await.map_err(ApiError::internal)?.map_err(ApiError::internal)?.ok_or_else(none)?;
    Ok((common, [(header::CONTENT_TYPE, "image/png")], png).into_response())
}
