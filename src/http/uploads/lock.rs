//! The lock of an upload: one request at a time writes to it.
//!
//! A newer request takes the lock over from an older one. Otherwise a dead connection, which the server has not noticed
//! yet, would keep its own client from resuming.

use std::time::Duration;

use tokio::{
    sync::broadcast::{Receiver, error::RecvError},
    time::{Instant, MissedTickBehavior, interval_at, sleep},
};
use uuid::Uuid;

use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App},
    store::{
        parts::LockedUpload,
        uploads::{PartialUpload, UploadState},
    },
};

/// How long the older request may take to store what it has received.
const HANDOVER: Duration = Duration::from_secs(15);
/// Interval between attempts to take the lock.
const RETRY: Duration = Duration::from_millis(20);

/// An upload that this request alone may change, until this is dropped.
pub struct UploadLock {
    /// Its row, read under the lock.
    pub upload: PartialUpload,
    /// Its bytes.
    pub parts: Box<dyn LockedUpload>,
    /// The generation of this request.
    pub generation: i64,
}

/// Locks an upload, taking it over from an older request if necessary. The [`Takeover`] reports when a newer request
/// asks for the lock.
///
/// # Errors
/// `not_found` when there is no such upload; `locked` when the older request does not release it in time.
pub async fn lock(app: &App, id: Uuid) -> ApiResult<(UploadLock, Takeover)> {
    // subscribe first, so that no change from here on is missed
    let changes = app.store.metadata.changes();
    let ours = app.store.metadata.take_over_upload(id).await?.ok_or_else(|| not_found(id))?;
    let deadline = Instant::now() + HANDOVER;
    loop {
        if let Some(parts) = app.store.parts.lock(id).await? {
            let upload = app.store.metadata.upload(id).await?;
            let is_receiving = upload.as_ref().is_some_and(|upload| upload.state == UploadState::Receiving);
            // an open upload may only seem to have expired, by a clock that jumped
            if !is_receiving && !app.store.metadata.upload_is_open(id).await? {
                // nothing will be written to it any more: remove its lock file
                app.store.parts.remove(id).await?;
            }
            let upload = upload.ok_or_else(|| not_found(id))?;
            let takeover = Takeover { app: app.clone(), id, ours, changes };
            return Ok((UploadLock { upload, parts, generation: ours }, takeover));
        }
        if Instant::now() >= deadline {
            let detail =
                format!("another request is writing to upload {id} and has not released it; try again in a moment");
            return Err(ApiError::new(Code::Locked, detail));
        }
        sleep(RETRY).await;
    }
}

/// The error for an upload that does not exist.
pub fn not_found(id: Uuid) -> ApiError {
    let detail = format!("there is no upload {id}: it never existed, was deleted, or has expired; begin a new one");
    ApiError::new(Code::NotFound, detail)
}

/// Checks that the upload was not refused.
///
/// # Errors
/// The error that it was refused with.
pub fn require_not_refused(upload: &PartialUpload) -> ApiResult<()> {
    match &upload.state {
        UploadState::Refused(fault) => Err((**fault).clone().into()),
        UploadState::Receiving | UploadState::Complete(_) => Ok(()),
    }
}

/// Reports when a newer request asks for the lock.
pub struct Takeover {
    app: App,
    id: Uuid,
    ours: i64,
    changes: Receiver<Uuid>,
}

impl Takeover {
    /// Completes when a newer request asks for the lock. Requests to this process are seen at once, requests to other
    /// processes at the next poll.
    pub async fn requested(mut self) {
        let pause = self.app.policy.poll_interval;
        let mut clock = interval_at(Instant::now() + pause, pause);
        clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            if !self.is_ours().await {
                return;
            }
            loop {
                tokio::select! {
                    changed = self.changes.recv() => match changed {
                        Ok(id) if id != self.id => {}
                        Ok(_) | Err(RecvError::Lagged(_)) => break,
                        Err(RecvError::Closed) => std::future::pending().await,
                    },
                    _ = clock.tick() => break,
                }
            }
        }
    }

    async fn is_ours(&self) -> bool {
        match self.app.store.metadata.upload(self.id).await {
            Ok(Some(upload)) => upload.generation == self.ours,
            Ok(None) => false,
            Err(error) => {
                tracing::warn!(?error, "cannot see whether an upload was taken over");
                true
            }
        }
    }
}
