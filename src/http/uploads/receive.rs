//! The bytes of one request. They are written, then synced, then counted in the row, and only then told to anybody.

use std::{pin::pin, time::Duration};

use axum::http::HeaderMap;
use futures::StreamExt;
use tokio::time::Instant;

use super::{
    checksum::Checksum,
    digest::RunningDigest,
    hold::{Held, Rival, unknown},
};
use crate::{
    contract::Code,
    http::{
        intake::{admission::content_length, body::WatchedBody, reservation::UploadReservation},
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::uploads::Advance,
};

/// So much is lost at most when the power goes.
const CHECKPOINT_BYTES: u64 = 32 << 20;
/// And so much on a slow line.
const CHECKPOINT_TIME: Duration = Duration::from_secs(5);

/// An upload that grows.
struct Growing<'a> {
    app: &'a App,
    held: &'a mut Held,
    digest: RunningDigest,
    reservation: UploadReservation,
    /// Bytes written, of which `held.upload.offset` are safe.
    written: u64,
    checkpoint: Instant,
}

/// Adds the body to the upload; its new offset stands in `held`. What arrived before the body broke off is kept, unless
/// there is a checksum, which only the whole body can fit.
///
/// # Errors
/// Why the body ended early; `checksum_mismatch`; `insufficient_storage`; `conflict` when another request took over.
pub async fn receive(
    app: &App,
    held: &mut Held,
    rival: Rival,
    mut body: WatchedBody,
    mut checksum: Option<Checksum>,
    reservation: UploadReservation,
) -> ApiResult<()> {
    let mut rival = pin!(rival.comes());
    let offset = held.upload.offset;
    if !held.partial.start_at(offset).await? {
        return Err(ApiError::internal(format!("the file of upload {} is shorter than its row says", held.upload.id)));
    }
    let digest = RunningDigest::resume(&held.upload.digest)?;
    let mut growing = Growing { app, held, digest, reservation, written: offset, checkpoint: Instant::now() };
    let ended = loop {
        let chunk = tokio::select! {
            biased;
            () = app.shutdown.cancelled() => break Err(going_down()),
            () = &mut rival => break Err(taken_over()),
            chunk = body.next() => chunk,
        };
        let chunk = match chunk {
            None => break Ok(()),
            Some(Err(_)) => break Err(broken_off()),
            Some(Ok(chunk)) => chunk,
        };
        if let Err(error) = growing.reservation.require(chunk.len() as u64).await {
            break Err(error);
        }
        if let Some(checksum) = &mut checksum {
            checksum.update(&chunk);
        }
        growing.write(chunk).await?;
        if checksum.is_none() && growing.is_due() {
            growing.save().await?;
        }
    };
    match (ended, checksum) {
        (Ok(()), None) => growing.save().await,
        (Ok(()), Some(checksum)) => {
            checksum.verify()?;
            growing.save().await
        }
        (Err(error), None) => {
            growing.save().await?;
            Err(error)
        }
        // nobody can say whether these bytes are right
        (Err(error), Some(_)) => Err(error),
    }
}

impl Growing<'_> {
    async fn write(&mut self, chunk: bytes::Bytes) -> ApiResult<()> {
        let length = chunk.len() as u64;
        let after = self.written + length;
        if after > self.held.upload.length {
            return Err(beyond(self.held.upload.length));
        }
        self.digest.update(&chunk);
        self.held.partial.write(chunk).await?;
        self.written = after;
        self.reservation.written(length);
        Ok(())
    }

    fn is_due(&self) -> bool {
        let unsafe_bytes = self.written - self.held.upload.offset;
        unsafe_bytes >= CHECKPOINT_BYTES || (unsafe_bytes > 0 && self.checkpoint.elapsed() >= CHECKPOINT_TIME)
    }

    /// Stable storage first, the row second.
    async fn save(&mut self) -> ApiResult<()> {
        let upload = &mut self.held.upload;
        if self.written == upload.offset {
            return Ok(());
        }
        self.held.partial.sync().await?;
        let advance = Advance {
            from: upload.offset,
            to: self.written,
            digest: self.digest.state(),
            keep: self.app.policy.upload_keep,
        };
        if !self.app.rows.advance_upload(upload.id, &advance).await? {
            return Err(unknown(upload.id));
        }
        (upload.offset, upload.digest) = (advance.to, advance.digest);
        self.checkpoint = Instant::now();
        Ok(())
    }
}

/// Refuses a body that would not fit, before it is read.
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
    let detail = format!("the body goes on beyond the {length} bytes that Upload-Length announced; begin a new upload");
    ApiError::new(Code::UploadTooLarge, detail)
}

fn broken_off() -> ApiError {
    let detail = "the body broke off or fell silent; what arrived before is safe unless it had an Upload-Checksum: ask for \
                  the offset by HEAD and go on from there";
    ApiError::new(Code::UploadIncomplete, detail)
}

fn going_down() -> ApiError {
    ApiError::new(Code::Unavailable, "the server goes down; what arrived is safe, go on when it is back")
}

fn taken_over() -> ApiError {
    ApiError::new(
        Code::Conflict,
        "a newer request goes on with this upload; this one was ended, what it brought is safe",
    )
}
