//! A file as an answer: streamed from the disk, with `ETag`, `Range` and a name.

use std::io::SeekFrom;

use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use tokio::{
    fs::File,
    io::{AsyncReadExt, AsyncSeekExt},
};
use tokio_util::io::ReaderStream;

use super::{
    name::disposition,
    range::{Wanted, wanted},
};
use crate::{
    http::{
        extract::conditional::{etag, not_modified},
        problem::{ApiError, ApiResult},
        state::App,
    },
    model::{Code, outcome::Artifact},
};

/// Bytes that are read from the disk at a time.
const CHUNK: usize = 128 << 10;

/// A file that can be sent.
#[derive(Debug)]
pub struct Download {
    /// The file, open: it can be sent to its end even when it is deleted meanwhile.
    pub file: File,
    /// Its size.
    pub length: u64,
    /// Its entity tag, without quotes.
    pub tag: String,
    /// Its kind.
    pub media_type: String,
    /// Its name for the client.
    pub name: String,
}

/// A file as the job stored it.
///
/// # Errors
/// `not_found` when it was deleted a moment ago.
pub async fn stored(app: &App, artifact: &Artifact, name: String) -> ApiResult<Download> {
    let gone = || ApiError::new(Code::NotFound, format!("the {} was deleted", artifact.name));
    let (file, length) = open(app, &artifact.key).await?.ok_or_else(gone)?;
    Ok(Download { file, length, tag: artifact.sha256.clone(), media_type: artifact.media_type.clone(), name })
}

/// A blob and its size; `None` when it is gone.
///
/// # Errors
/// When it cannot be read.
pub async fn open(app: &App, key: &str) -> ApiResult<Option<(File, u64)>> {
    let Some(path) = app.blobs.local_path(key).await? else { return Ok(None) };
    match File::open(path).await {
        Ok(file) => {
            let length = file.metadata().await.map_err(ApiError::internal)?.len();
            Ok(Some((file, length)))
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(ApiError::internal(format!("blob {key}: {error}"))),
    }
}

impl Download {
    /// The answer: 200, 206 or 304.
    ///
    /// # Errors
    /// `range_not_satisfiable`.
    pub async fn answer(mut self, headers: &HeaderMap) -> ApiResult<Response> {
        if not_modified(headers, &self.tag) {
            return Ok((StatusCode::NOT_MODIFIED, self.common_headers()).into_response());
        }
        let (status, first, length) = match wanted(headers, self.length, &self.tag) {
            Wanted::Whole => (StatusCode::OK, 0, self.length),
            Wanted::Part { first, last } => (StatusCode::PARTIAL_CONTENT, first, last - first + 1),
            Wanted::Unsatisfiable => {
                let detail = format!("the file has {} bytes; the range lies outside", self.length);
                let error = ApiError::new(Code::RangeNotSatisfiable, detail);
                return Err(error.with_header(header::CONTENT_RANGE, format!("bytes */{}", self.length)));
            }
        };
        let mut out = self.common_headers();
        out.insert(header::CONTENT_LENGTH, length.into());
        out.insert(header::CONTENT_DISPOSITION, disposition(&self.name));
        if let Ok(kind) = HeaderValue::from_str(&self.media_type) {
            out.insert(header::CONTENT_TYPE, kind);
        }
        if status == StatusCode::PARTIAL_CONTENT
            && let Ok(range) = HeaderValue::from_str(&format!("bytes {first}-{}/{}", first + length - 1, self.length))
        {
            out.insert(header::CONTENT_RANGE, range);
        }
        self.file.seek(SeekFrom::Start(first)).await.map_err(ApiError::internal)?;
        let body = Body::from_stream(ReaderStream::with_capacity(self.file.take(length), CHUNK));
        Ok((status, out, body).into_response())
    }

    fn common_headers(&self) -> HeaderMap {
        HeaderMap::from_iter([
            (header::ETAG, etag(&self.tag)),
            (header::ACCEPT_RANGES, HeaderValue::from_static("bytes")),
            // a result never changes but can be deleted: ask, and hear 304
            (header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache")),
        ])
    }
}
