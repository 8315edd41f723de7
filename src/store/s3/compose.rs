//! Objects put together within the bucket: the server copies ranges of other objects, so that their bytes pass neither
//! this machine nor the network.
//!
//! S3 calls this *UploadPartCopy*. `object_store` has no call for it, but signs the requests. Every part but the last
//! must have 5 MiB, so shorter ranges are joined here and sent.

use std::{ops::Range, time::Instant};

use anyhow::{Context, anyhow};
use bytes::{Bytes, BytesMut};
use futures::{StreamExt, TryStreamExt, stream};
use http_body_util::BodyExt;
use hyper::http;
use object_store::{
    ObjectStoreExt,
    client::{HttpRequest, HttpRequestBody},
    multipart::{MultipartStore, PartId},
    path::Path,
    signer::{Method, SignedUrlOptions, Signer},
};
use serde::Deserialize;
use tokio::sync::Semaphore;

use super::bucket::{Bucket, MOST_PARTS, RETRY, cannot, cannot_change, found};
use crate::store::{StoreError, StoreResult, failpoint::step};

/// Fewest bytes of a part that is not the last.
const LEAST: u64 = 5 << 20;
/// Most bytes that the server copies in one request. S3 allows 5 GiB, but a server that really copies must answer
/// within the time limit of a request.
const MOST: u64 = 64 << 20;
/// Largest object that the server copies in one request.
const MOST_TO_COPY: u64 = 5 << 30;
/// Copies at a time. They carry no bytes.
const COPIES_AT_ONCE: usize = 16;
/// Parts that are joined at a time. Each takes up to 15 MiB of memory: less than [`LEAST`] and one more piece.
const JOINED_AT_ONCE: usize = 2;
/// How long a signed request is valid.
const VALID: std::time::Duration = std::time::Duration::from_secs(15 * 60);
/// Between two attempts of one request, at first.
const PAUSE: std::time::Duration = std::time::Duration::from_millis(100);

/// A range of an object.
pub(super) type Piece = (String, Range<u64>);

/// A part of the new object.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    /// The server copies it.
    Copy(Piece),
    /// Too short for that: read and sent.
    Joined(Vec<Piece>),
}

/// What came of an attempt to compose an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Composed {
    /// It is there.
    Done,
    /// A source is gone.
    Gone,
    /// The server does not copy ranges, or there are too many.
    Unable,
}

/// Why a part cannot be made.
#[derive(Debug)]
enum Obstacle {
    /// A source is gone.
    Gone,
    /// The server does not copy ranges.
    Unable,
    /// The bucket failed.
    Failed(StoreError),
}

impl From<StoreError> for Obstacle {
    fn from(error: StoreError) -> Self {
        Self::Failed(error)
    }
}

/// The parts of an object that has the bytes of `pieces`, in their order.
fn parts_of(pieces: impl IntoIterator<Item = Piece>) -> Vec<Part> {
    let mut parts = Vec::new();
    let (mut short, mut length) = (Vec::new(), 0);
    for (key, range) in pieces.into_iter().flat_map(cut) {
        let size = range.end - range.start;
        if short.is_empty() && size >= LEAST {
            parts.push(Part::Copy((key, range)));
            continue;
        }
        short.push((key, range));
        length += size;
        if length >= LEAST {
            parts.push(Part::Joined(std::mem::take(&mut short)));
            length = 0;
        }
    }
    // the last one may be short
    match short.len() {
        0 => {}
        1 => parts.extend(short.pop().map(Part::Copy)),
        _ => parts.push(Part::Joined(short)),
    }
    parts
}

/// A piece in ranges of at most [`MOST`], none of which is short if the piece is not.
fn cut((key, range): Piece) -> impl Iterator<Item = Piece> {
    let size = range.end - range.start;
    let count = size.div_ceil(MOST);
    let at = move |index: u64| range.start + size / count.max(1) * index + (size % count.max(1)).min(index);
    (0..count).map(move |index| (key.clone(), at(index)..at(index + 1)))
}

impl Bucket {
    /// Copies an object within the bucket. False: it is gone, or the server cannot copy one that is so large.
    pub(super) async fn copy(&self, from: &str, to: &str, size: u64) -> StoreResult<bool> {
        if size > MOST_TO_COPY {
            return Ok(self.compose(to, vec![(from.to_owned(), 0..size)]).await? == Composed::Done);
        }
        step("s3.copy").map_err(cannot_change)?;
        let copied = self.store.copy(&self.path(from)?, &self.path(to)?).await;
        if found(copied, || format!("copy {from} to {to}"))?.is_none() {
            return Ok(false);
        }
        self.require_size(to, size).await?;
        Ok(true)
    }

    /// Makes the object `key` of pieces of others, in place of one that is there, and compares its size with what the
    /// bucket then says.
    pub(super) async fn compose(&self, key: &str, pieces: Vec<Piece>) -> StoreResult<Composed> {
        let size = pieces.iter().map(|(_, range)| range.end - range.start).sum();
        let parts = parts_of(pieces);
        if !self.composes || parts.len() as u64 > MOST_PARTS {
            return Ok(Composed::Unable);
        }
        let path = self.path(key)?;
        let _turn = self.turn().await?;
        step("s3.compose").map_err(cannot_change)?;
        let upload = self.store.create_multipart(&path).await.map_err(cannot(|| format!("begin to compose {key}")))?;
        let ids = match self.compose_parts(&path, &upload, parts).await {
            Ok(ids) => ids,
            Err(obstacle) => {
                // what remains is removed by the lifecycle rule of the bucket
                if let Err(error) = self.store.abort_multipart(&path, &upload).await {
                    tracing::warn!(%error, key, "the parts of a failed upload stay in the bucket");
                }
                return match obstacle {
                    Obstacle::Gone => Ok(Composed::Gone),
                    Obstacle::Unable => Ok(Composed::Unable),
                    Obstacle::Failed(error) => Err(error),
                };
            }
        };
        step("s3.composed").map_err(cannot_change)?;
        let completed = self.store.complete_multipart(&path, &upload, ids).await;
        completed.map_err(cannot(|| format!("complete {key}")))?;
        self.require_size(key, size).await?;
        Ok(Composed::Done)
    }

    /// The ids of all parts. The first obstacle ends it.
    async fn compose_parts(&self, path: &Path, upload: &String, parts: Vec<Part>) -> Result<Vec<PartId>, Obstacle> {
        let joining = &Semaphore::new(JOINED_AT_ONCE);
        stream::iter(parts.into_iter().enumerate())
            .map(|(index, part)| async move {
                match part {
                    Part::Copy(piece) => self.copy_part(path, upload, index, &piece).await,
                    Part::Joined(pieces) => {
                        let _turn =
                            joining.acquire().await.context("it is open as long as this").map_err(StoreError::from)?;
                        self.send_part(path, upload, index, &pieces).await
                    }
                }
            })
            .buffered(COPIES_AT_ONCE)
            .try_collect()
            .await
    }

    async fn send_part(
        &self,
        path: &Path,
        upload: &String,
        index: usize,
        pieces: &[Piece],
    ) -> Result<PartId, Obstacle> {
        let mut bytes = BytesMut::new();
        for (key, range) in pieces {
            match self.get(key, range.clone()).await? {
                Some(piece) => bytes.extend_from_slice(&piece),
                None => return Err(Obstacle::Gone),
            }
        }
        let sent = self.store.put_part(path, upload, index, bytes.freeze().into()).await;
        Ok(sent.map_err(cannot(|| format!("store a part of {path}")))?)
    }

    /// Repeats the request as `object_store` does with its own.
    async fn copy_part(&self, path: &Path, upload: &str, index: usize, piece: &Piece) -> Result<PartId, Obstacle> {
        let (started, mut pause) = (Instant::now(), PAUSE);
        loop {
            match self.try_copy_part(path, upload, index, piece).await? {
                Answer::Copied(id) => return Ok(id),
                Answer::No(obstacle) => return Err(obstacle),
                Answer::Again(error) if started.elapsed() > RETRY => {
                    let error = error.context(format!("the bucket: cannot copy {}", piece.0));
                    return Err(StoreError::Unavailable(error).into());
                }
                Answer::Again(error) => tracing::debug!(?error, key = piece.0, "cannot copy within the bucket yet"),
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(std::time::Duration::from_secs(3));
        }
    }

    async fn try_copy_part(
        &self,
        path: &Path,
        upload: &str,
        index: usize,
        (key, range): &Piece,
    ) -> StoreResult<Answer> {
        // keys of the service need no encoding, and neither do the names of buckets
        let source = format!("/{}/{}", self.name, self.path(key)?);
        let range = format!("bytes={}-{}", range.start, range.end.saturating_sub(1));
        let number = (index + 1).to_string();
        let query = [("partNumber", number.as_str()), ("uploadId", upload)];
        let mut options = SignedUrlOptions::new().with_query(query);
        let mut request = http::Request::builder().method(Method::PUT);
        for (name, value) in [("x-amz-copy-source", source), ("x-amz-copy-source-range", range)] {
            let value = http::HeaderValue::try_from(value).context("a key that no header can hold")?;
            options = options.with_signed_header(http::HeaderName::from_static(name), value.clone());
            request = request.header(name, value);
        }
        let url = self.store.signed_url_opts(Method::PUT, path, VALID, &options).await;
        let url = url.map_err(cannot(|| format!("sign a copy of {key}")))?;
        let request = request.header(http::header::CONTENT_LENGTH, 0).uri(url.as_str());
        let request = request.body(HttpRequestBody::empty()).context("a URL that is none")?;
        Ok(self.send_copy(request).await)
    }

    async fn send_copy(&self, request: HttpRequest) -> Answer {
        if let Err(error) = step("s3.part") {
            return Answer::Again(error.into());
        }
        let answer = match self.http.execute(request).await {
            Ok(answer) => answer,
            Err(error) => return Answer::Again(error.into()),
        };
        let (head, body) = answer.into_parts();
        let body = match body.collect().await {
            Ok(body) => body.to_bytes(),
            Err(error) => return Answer::Again(error.into()),
        };
        Answer::of(head.status, &body)
    }
}

/// What the bucket says to one request for a copy.
#[derive(Debug)]
enum Answer {
    Copied(PartId),
    No(Obstacle),
    /// It may go better the next time.
    Again(anyhow::Error),
}

/// Body of an answer to *UploadPartCopy*, `CopyPartResult` or `Error`.
#[derive(Debug, Deserialize)]
struct CopyAnswer {
    #[serde(rename = "ETag")]
    etag: Option<String>,
    #[serde(rename = "Code")]
    code: Option<String>,
}

impl Answer {
    /// A copy can fail after the status was sent, so the body decides.
    fn of(status: http::StatusCode, body: &Bytes) -> Self {
        let text = String::from_utf8_lossy(body);
        let answer: CopyAnswer = quick_xml::de::from_str(&text).unwrap_or(CopyAnswer { etag: None, code: None });
        match (answer.etag, answer.code.as_deref()) {
            (Some(etag), None) if status.is_success() => Self::Copied(PartId { content_id: etag }),
            (_, Some("NoSuchKey")) => Self::No(Obstacle::Gone),
            (_, Some("NotImplemented")) => Self::No(Obstacle::Unable),
            _ if status == http::StatusCode::NOT_IMPLEMENTED => Self::No(Obstacle::Unable),
            (_, code) => Self::Again(anyhow!("the bucket answered {status} {}", code.unwrap_or("without a reason"))),
        }
    }
}

#[cfg(test)]
mod tests;
