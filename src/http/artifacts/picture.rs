//! A picture of a job as an answer: the stored file, or the same in the format that `Accept` asks for.

use axum::{
    http::{HeaderMap, HeaderValue, Method, header},
    response::Response,
};

use super::{
    accept::{self, Formats},
    download::{self, Content, Download},
    name, outcome,
};
use crate::{
    contract::outcome::Artifact,
    http::{
        extract::conditional::{not_modified, require_match},
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::Job,
};

/// The answer to a `GET` or `HEAD` of the picture `what` of a job.
///
/// # Errors
/// What [`outcome::artifact`], [`download::stored`] and [`Download::answer`] say; `insufficient_storage` when there is no room
/// for a converted file.
pub async fn answer(
    app: &App,
    job: &Job,
    what: &str,
    formats: Formats,
    method: &Method,
    headers: &HeaderMap,
) -> ApiResult<Response> {
    let artifact = outcome::artifact(job, what)?;
    let download = match accept::choose(headers, formats, &artifact.media_type) {
        None => download::stored(app, job, artifact, name::of(job, what, &artifact.media_type)).await?,
        Some(media_type) => converted(app, job, artifact, media_type, method, headers).await?,
    };
    let mut response = download.answer(headers).await?;
    if formats != Formats::Stored {
        response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    }
    Ok(response)
}

/// The picture as `media_type`. It is made only when its bytes are needed: not for `HEAD`, and not for a client that has it.
async fn converted(
    app: &App,
    job: &Job,
    artifact: &Artifact,
    media_type: &'static str,
    method: &Method,
    headers: &HeaderMap,
) -> ApiResult<Download> {
    // the bytes depend on the encoder too
    let format = media_type.trim_start_matches("image/");
    let tag = format!("{}-{format}-{}", artifact.sha256, env!("CARGO_PKG_VERSION"));
    require_match(headers, &tag)?;
    let kept = app.conversions.kept(&artifact.sha256, media_type);
    let file = if kept.is_some() || method == Method::HEAD || not_modified(headers, &tag) {
        kept
    } else {
        // a damaged file is not converted either
        drop(download::stored(app, job, artifact, String::new()).await?);
        let path = download::stored_path(app, job, artifact).await?;
        Some(app.conversions.get(app, path, &artifact.sha256, media_type).await?)
    };
    let content = match file {
        Some(converted) => {
            let file = tokio::fs::File::open(converted.path()).await.map_err(ApiError::internal)?;
            Some(Content { file, length: converted.length })
        }
        None => None,
    };
    Ok(Download { content, tag, media_type: media_type.to_owned(), name: name::of(job, &artifact.name, media_type) })
}
