//! An upload in the hands of one request. A newer one takes it over: a connection that died without a word must not
//! lock its client out.

use std::time::Duration;

use tokio::{
    sync::broadcast::{Receiver, error::RecvError},
    time::{Instant, MissedTickBehavior, interval_at, sleep},
};
use uuid::Uuid;

use crate::{
    contract::Code,
    http::{
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::{
        blobs::Partial,
        uploads::{PartialUpload, UploadState},
    },
};

/// The request before has so long to put away what it has.
const HANDOVER: Duration = Duration::from_secs(15);
/// How often it is looked whether it has.
const RETRY: Duration = Duration::from_millis(20);

/// An upload, held until this is dropped.
pub struct Held {
    /// As its row was once it was held; nobody else changes it meanwhile.
    pub upload: PartialUpload,
    /// Its file.
    pub partial: Box<dyn Partial>,
}

/// Takes an upload over from whoever has it; the rival tells when somebody takes it over from here.
///
/// # Errors
/// `not_found` when there is no such upload; `locked` when the request before does not let go.
pub async fn hold(app: &App, id: Uuid) -> ApiResult<(Held, Rival)> {
    // listen first: nothing that happens from here on is missed
    let changes = app.rows.changes();
    let ours = app.rows.take_over_upload(id).await?.ok_or_else(|| unknown(id))?;
    let deadline = Instant::now() + HANDOVER;
    loop {
        if let Some(partial) = app.blobs.hold_partial(id).await? {
            let upload = app.rows.upload(id).await?;
            if upload.as_ref().is_none_or(|upload| upload.state != UploadState::Receiving) {
                // nothing will be written to it: its lock need not lie about
                app.blobs.remove_partial(id).await?;
            }
            let upload = upload.ok_or_else(|| unknown(id))?;
            let rival = Rival { app: app.clone(), id, ours, changes };
            return Ok((Held { upload, partial }, rival));
        }
        if Instant::now() >= deadline {
            let detail =
                format!("another request is writing to upload {id} and does not let go; try again in a moment");
            return Err(ApiError::new(Code::Locked, detail));
        }
        sleep(RETRY).await;
    }
}

/// There is no such upload.
pub fn unknown(id: Uuid) -> ApiError {
    let detail =
        format!("there is no upload {id}; it never was, was ended, or nobody went on with it in time: begin a new one");
    ApiError::new(Code::NotFound, detail)
}

/// Why an upload that was refused cannot be gone on with.
///
/// # Errors
/// What it was refused with.
pub fn not_refused(upload: &PartialUpload) -> ApiResult<()> {
    match &upload.state {
        UploadState::Refused(fault) => Err((**fault).clone().into()),
        UploadState::Receiving | UploadState::Complete(_) => Ok(()),
    }
}

/// The newer request, if one comes.
pub struct Rival {
    app: App,
    id: Uuid,
    ours: i64,
    changes: Receiver<Uuid>,
}

impl Rival {
    /// Ends when a newer request wants the upload. Requests of this process are heard at once, those of others are
    /// asked for now and then.
    pub async fn comes(mut self) {
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
        match self.app.rows.upload(self.id).await {
            Ok(Some(upload)) => upload.generation == self.ours,
            Ok(None) => false,
            Err(error) => {
                tracing::warn!(?error, "cannot see whether an upload was taken over");
                true
            }
        }
    }
}
