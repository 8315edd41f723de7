//! Sends a file: streamed from the blob store, with `ETag`, `Range` and a file name.

use std::{convert::Infallible, io::SeekFrom, sync::Arc};

use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
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
    contract::{Code, JobKind, outcome::Artifact},
    http::{
        ApiError, ApiResult, App,
        extract::{conditional::require_match, etag, not_modified},
        scans::stored_zip::StoredZip,
    },
    store::{BlobStore, Job},
};

/// Bytes read from the disk at a time.
const CHUNK: usize = 128 << 10;

/// A file that can be sent.
pub struct Download {
    /// Its bytes; `None` for a conversion that is not made because its bytes are not needed.
    pub content: Option<Content>,
    /// Its entity tag, without quotes.
    pub tag: String,
    /// Its media type.
    pub media_type: String,
    /// Its file name.
    pub name: String,
}

/// The bytes of a download.
pub struct Content {
    /// Where they are.
    pub source: Source,
    /// How many there are.
    pub length: u64,
}

/// Where the bytes of a download are.
pub enum Source {
    /// In the blob store, under this key.
    Blob(Arc<dyn BlobStore>, String),
    /// In an open file.
    File(File),
    /// A zip of stored files.
    Zip(Arc<dyn BlobStore>, StoredZip),
}

impl Source {
    /// A part of the bytes. A single blob can be sent completely even if it is deleted meanwhile; a zip ends with an
    /// error at the first blob that is gone.
    async fn body(self, first: u64, length: u64) -> ApiResult<Body> {
        match self {
            Self::Blob(blobs, key) => {
                let deleted = || ApiError::new(Code::NotFound, "the file was deleted");
                Ok(Body::from_stream(blobs.read(&key, first..first + length).await?.ok_or_else(deleted)?))
            }
            Self::Zip(blobs, zip) => Ok(Body::from_stream(zip.stream(blobs, first, length))),
            Self::File(mut file) => {
                file.seek(SeekFrom::Start(first)).await.map_err(ApiError::internal)?;
                Ok(Body::from_stream(ReaderStream::with_capacity(file.take(length), CHUNK)))
            }
        }
    }
}

/// A file as the job stored it.
///
/// # Errors
/// `not_found` when the job was deleted meanwhile; `internal` when the file is missing or its size differs from its
/// row.
pub async fn stored(app: &App, job: &Job, artifact: &Artifact, name: String) -> ApiResult<Download> {
    let Some(content) = content(app, &artifact.key).await? else { return Err(missing(app, job, artifact).await) };
    if content.length != artifact.bytes {
        let found = format!("has {} bytes instead of the {} in its row", content.length, artifact.bytes);
        return Err(damaged(job, artifact, &found));
    }
    let (tag, media_type) = (artifact.sha256.clone(), artifact.media_type.clone());
    Ok(Download { content: Some(content), tag, media_type, name })
}

/// All bytes of a small file of a job.
///
/// # Errors
/// As [`stored`]; `not_found` when the blob is deleted meanwhile; `internal` when it cannot be read.
pub async fn bytes(app: &App, job: &Job, artifact: &Artifact) -> ApiResult<Bytes> {
    let Download { content, .. } = stored(app, job, artifact, String::new()).await?;
    let Content { source, length } = content.ok_or_else(|| ApiError::internal("a stored file has no bytes"))?;
    axum::body::to_bytes(source.body(0, length).await?, usize::MAX).await.map_err(ApiError::internal)
}

/// The error for a missing file: the job was deleted since the row was read, or the file was lost.
async fn missing(app: &App, job: &Job, artifact: &Artifact) -> ApiError {
    match app.store.metadata.job(job.id).await {
        Ok(Some(row)) if row.outcome.as_ref().is_some_and(|o| o.artifacts().contains(artifact)) => {
            damaged(job, artifact, "is missing")
        }
        Ok(_) => ApiError::new(Code::NotFound, format!("the {} was deleted", artifact.name)),
        Err(error) => error.into(),
    }
}

/// The error for a file that does not match its row. It is not sent, because its `ETag` would be wrong.
fn damaged(job: &Job, artifact: &Artifact, found: &str) -> ApiError {
    tracing::error!(key = artifact.key, "a stored result {found}; `pinstack verify` lists all damaged results");
    let remedy = match job.request.kind() {
        JobKind::Stack => "fuse the stack again",
        JobKind::Calibration => "send the target stack again",
        JobKind::Reconstruction => "reconstruct the scan again",
    };
    let detail = format!(
        "the stored file of the {} is damaged; {remedy}, and ask the operator to run `pinstack verify`",
        artifact.name
    );
    ApiError::new(Code::Internal, detail)
}

/// The content of a blob; `None` when it does not exist.
///
/// # Errors
/// When the blob store cannot be read.
pub async fn content(app: &App, key: &str) -> ApiResult<Option<Content>> {
    let Some(blob) = app.store.blobs.head(key).await? else { return Ok(None) };
    Ok(Some(Content { source: Source::Blob(Arc::clone(&app.store.blobs), key.to_owned()), length: blob.size }))
}

impl Download {
    /// The response: 200, 206 or 304.
    ///
    /// # Errors
    /// `precondition_failed`, `range_not_satisfiable`.
    pub async fn answer(self, headers: &HeaderMap) -> ApiResult<Response> {
        require_match(headers, &self.tag)?;
        if not_modified(headers, &self.tag) {
            return Ok((StatusCode::NOT_MODIFIED, self.common_headers()).into_response());
        }
        let mut out = self.common_headers();
        out.insert(header::CONTENT_DISPOSITION, disposition(&self.name));
        if let Ok(kind) = HeaderValue::from_str(&self.media_type) {
            out.insert(header::CONTENT_TYPE, kind);
        }
        let Some(Content { source, length: total }) = self.content else {
            // a stream: an empty body would be sent with Content-Length: 0
            let nothing = futures::stream::empty::<Result<Bytes, Infallible>>();
            return Ok((StatusCode::OK, out, Body::from_stream(nothing)).into_response());
        };
        let (status, first, length) = match wanted(headers, total, &self.tag) {
            Wanted::Whole => (StatusCode::OK, 0, total),
            Wanted::Part { first, last } => (StatusCode::PARTIAL_CONTENT, first, last - first + 1),
            Wanted::Unsatisfiable => {
                let detail = format!("the range is outside the file, which has {total} bytes");
                let error = ApiError::new(Code::RangeNotSatisfiable, detail);
                return Err(error.with_header(header::CONTENT_RANGE, format!("bytes */{total}")));
            }
        };
        out.insert(header::CONTENT_LENGTH, length.into());
        if status == StatusCode::PARTIAL_CONTENT
            && let Ok(range) = HeaderValue::from_str(&format!("bytes {first}-{}/{total}", first + length - 1))
        {
            out.insert(header::CONTENT_RANGE, range);
        }
        let body = source.body(first, length).await?;
        Ok((status, out, body).into_response())
    }

    fn common_headers(&self) -> HeaderMap {
        HeaderMap::from_iter([
            (header::ETAG, etag(&self.tag)),
            (header::ACCEPT_RANGES, HeaderValue::from_static("bytes")),
            // a result never changes but can be deleted: clients revalidate and get 304
            (header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache")),
        ])
    }
}
