//! Appends the body of one request to an upload. Bytes are written, then synced, then counted in the row, and only then
//! reported to a client.

use std::{pin::pin, time::Duration};

use axum::http::HeaderMap;
use futures::StreamExt;
use tokio::time::Instant;

use super::{
    checksum::Checksum,
    digest::RunningDigest,
    lock::{Takeover, UploadLock, not_found},
};
use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult, App,
        ingest::{
            body::{WatchedBody, content_length},
            reservation::UploadReservation,
        },
    },
    store::uploads::Advance,
};

/// Bytes written between two syncs: at most this much is lost in a power failure.
const CHECKPOINT_BYTES: u64 = 32 << 20;
/// Time between two syncs, for slow connections.
const CHECKPOINT_TIME: Duration = Duration::from_secs(5);

/// An upload in progress.
struct Appending<'a> {
    app: &'a App,
    locked: &'a mut UploadLock,
    digest: RunningDigest,
    reservation: UploadReservation,
    /// Bytes written, of which `locked.upload.offset` are on stable storage.
    written: u64,
    checkpoint: Instant,
}

/// Appends the body to the upload and updates its offset in `locked`. If the body ends early, what arrived is kept,
/// unless there is a checksum, which can only be verified for the whole body.
///
/// # Errors
/// `upload_incomplete` or `unavailable` when the body ended early; `checksum_mismatch`; `insufficient_storage`;
/// `conflict` when another request took over.
pub async fn receive(
    app: &App,
    locked: &mut UploadLock,
    takeover: Takeover,
    mut body: WatchedBody,
    mut checksum: Option<Checksum>,
    reservation: UploadReservation,
) -> ApiResult<()> {
    let mut takeover = pin!(takeover.requested());
    let offset = locked.upload.offset;
    if !locked.parts.resume_at(offset, locked.generation).await? {
        return Err(ApiError::internal(format!(
            "the file of upload {} is shorter than its row says",
            locked.upload.id
        )));
    }
    let digest = RunningDigest::resume(&locked.upload.digest)?;
    let mut appending = Appending { app, locked, digest, reservation, written: offset, checkpoint: Instant::now() };
    let ended = loop {
        let chunk = tokio::select! {
            biased;
            () = app.shutdown.cancelled() => break Err(shutting_down()),
            () = &mut takeover => break Err(taken_over()),
            chunk = body.next() => chunk,
        };
        let chunk = match chunk {
            None => break Ok(()),
            Some(Err(_)) => break Err(broken_off()),
            Some(Ok(chunk)) => chunk,
        };
        if let Err(error) = appending.reservation.require(chunk.len() as u64).await {
            break Err(error);
        }
        if let Some(checksum) = &mut checksum {
            checksum.update(&chunk);
        }
        appending.write(chunk).await?;
        if checksum.is_none() && appending.is_due() {
            appending.save().await?;
        }
    };
    match (ended, checksum) {
        (Ok(()), None) => appending.save().await,
        (Ok(()), Some(checksum)) => {
            checksum.verify()?;
            appending.save().await
        }
        (Err(error), None) => {
            appending.save().await?;
            Err(error)
        }
        // these bytes cannot be verified
        (Err(error), Some(_)) => Err(error),
    }
}

impl Appending<'_> {
    async fn write(&mut self, chunk: bytes::Bytes) -> ApiResult<()> {
        let length = chunk.len() as u64;
        let after = self.written + length;
        if after > self.locked.upload.length {
            return Err(beyond(self.locked.upload.length));
        }
        self.digest.update(&chunk);
        self.locked.parts.append(chunk).await?;
        self.written = after;
        self.reservation.written(length);
        Ok(())
    }

    fn is_due(&self) -> bool {
        let unsafe_bytes = self.written - self.locked.upload.offset;
        unsafe_bytes >= CHECKPOINT_BYTES || (unsafe_bytes > 0 && self.checkpoint.elapsed() >= CHECKPOINT_TIME)
    }

    /// Syncs the file, then records the offset in the row.
    async fn save(&mut self) -> ApiResult<()> {
        let UploadLock { upload, parts, generation } = &mut *self.locked;
        if self.written == upload.offset {
            return Ok(());
        }
        parts.sync().await?;
        let advance = Advance {
            from: upload.offset,
            to: self.written,
            digest: self.digest.state(),
            keep: self.app.policy.upload_keep,
            generation: (!parts.is_exclusive()).then_some(*generation),
        };
        let metadata = &self.app.store.metadata;
        if !metadata.advance_upload(upload.id, &advance).await? {
            let is_there = metadata.upload(upload.id).await?.is_some();
            return Err(if is_there { overtaken() } else { not_found(upload.id) });
        }
        (upload.offset, upload.digest) = (advance.to, advance.digest);
        self.checkpoint = Instant::now();
        Ok(())
    }
}

/// Checks before the body is read that it ends within the upload.
///
/// # Errors
/// `upload_too_large`.
pub fn require_fit(headers: &HeaderMap, offset: u64, length: u64) -> ApiResult<()> {
    match content_length(headers) {
        Some(bytes) if offset.saturating_add(bytes) > length => Err(beyond(length)),
        _ => Ok(()),
    }
}

fn beyond(length: u64) -> ApiError {
    let detail = format!(
        "the body extends beyond the {length} bytes of Upload-Length; begin a new upload with the right length"
    );
    ApiError::new(Code::UploadTooLarge, detail)
}

fn broken_off() -> ApiError {
    let detail = "the body ended early or timed out; what arrived is stored, unless the request had an Upload-Checksum; \
                  get the offset with HEAD and continue from there";
    ApiError::new(Code::UploadIncomplete, detail)
}

fn shutting_down() -> ApiError {
    let detail = "the server is shutting down; what arrived is stored, unless the request had an Upload-Checksum; when \
                  the server is back, get the offset with HEAD and continue from there";
    ApiError::new(Code::Unavailable, detail)
}

/// As [`taken_over`], where the newer request is in another process.
fn overtaken() -> ApiError {
    let detail = "a newer request has taken over this upload, so this one was ended; what it sent since the last \
                  recorded offset is not stored; get the offset with HEAD";
    ApiError::new(Code::Conflict, detail)
}

fn taken_over() -> ApiError {
    ApiError::new(
        Code::Conflict,
        "a newer request has taken over this upload, so this one was ended; what it sent is stored, unless it had an Upload-Checksum",
    )
}
