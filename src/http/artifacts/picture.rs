//! Downloads of the pictures of a stack: the stored file, or a conversion to the format in `Accept`.

use axum::{
    http::{HeaderMap, HeaderValue, Method, header},
    response::Response,
};

use super::{
    accept,
    download::{self, Content, Download, Source},
    name, outcome,
    redirect::MayRedirect,
};
use crate::{
    contract::{artifact::FileFormat, outcome::Artifact},
    http::{
        ApiError, ApiResult, App,
        extract::conditional::{not_modified, require_match},
        state::conversions::conversion::{Conversion, Form},
    },
    store::Job,
};

/// The response to `GET` or `HEAD` of a picture of a stack: of the name of its file, and the formats that it can be
/// converted to.
///
/// # Errors
/// Those of [`outcome::artifact`], [`download::stored`] and [`Download::answer`]; `insufficient_storage` when there is
/// no disk space for a converted file.
pub async fn answer(
    app: &App,
    job: &Job,
    (picture, formats): (&str, &[FileFormat]),
    method: &Method,
    headers: &HeaderMap,
    redirect: MayRedirect,
) -> ApiResult<Response> {
    let artifact = outcome::artifact(job, picture)?;
    let download = match accept::choose(headers, formats, &artifact.media_type) {
        None => download::stored(app, job, artifact, name::of(job, picture, &artifact.media_type)).await?,
        Some(format) => converted(app, job, artifact, format, method, headers).await?,
    };
    let disposition = name::disposition(&download.name);
    let mut response = match redirect.answer(app, &download, &disposition, headers).await? {
        Some(redirect) => redirect,
        None => download.answer(headers).await?,
    };
    if !formats.is_empty() {
        response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    }
    Ok(response)
}

/// The picture in another format. It is converted only when its bytes are needed: not for `HEAD`, and not when the copy
/// of the client is current.
async fn converted(
    app: &App,
    job: &Job,
    artifact: &Artifact,
    format: FileFormat,
    method: &Method,
    headers: &HeaderMap,
) -> ApiResult<Download> {
    // the bytes depend on the version of the encoder too
    let subtype = format.media_type().trim_start_matches("image/");
    let tag = format!("{}-{subtype}-{}", artifact.sha256, env!("CARGO_PKG_VERSION"));
    require_match(headers, &tag)?;
    let kept = app.conversions.kept(&artifact.sha256, Form::File(format));
    let file = if kept.is_some() || method == Method::HEAD || not_modified(headers, &tag) {
        kept
    } else {
        // refuses a damaged file
        drop(download::stored(app, job, artifact, String::new()).await?);
        Some(app.conversions.get(&artifact.key, &artifact.sha256, Conversion::File(format)).await?)
    };
    let content = match file {
        Some(converted) => {
            let file = tokio::fs::File::open(converted.path()).await.map_err(ApiError::internal)?;
            Some(Content { source: Source::File(file), length: converted.length })
        }
        None => None,
    };
    let media_type = format.media_type();
    Ok(Download { content, tag, media_type: media_type.to_owned(), name: name::of(job, &artifact.name, media_type) })
}
