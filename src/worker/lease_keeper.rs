//! Keeps the lease of one running job: sends heartbeats with the progress that the job reports, and stops the job when
//! it is cancelled, when its lease is lost, or at shutdown.

use std::{
    sync::{
        Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use tokio::{
    sync::{Notify, broadcast::error::RecvError},
    time::{Instant, sleep_until},
};
use tokio_util::sync::{CancellationToken, DropGuard};

use super::{
    Config, Deps,
    stages::{StageTimes, Visit},
};
use crate::{
    contract::Progress,
    jobs::ProgressSink,
    store::{Heartbeat, Job, StoreResult},
};
use pinstack_science::types::Cancelled;

/// Why a job must stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StopReason {
    /// A client cancelled or deleted it.
    Cancelled,
    /// Another worker has the lease.
    Lost,
    /// The process shuts down; the job returns to the queue.
    ShuttingDown,
}

/// The state that the thread of the job and its heartbeats share.
#[derive(Default)]
pub(super) struct LeaseKeeper {
    progress: Mutex<Progress>,
    stages: Mutex<StageTimes>,
    has_news: AtomicBool,
    news: Notify,
    reason: OnceLock<StopReason>,
    stopped: CancellationToken,
}

impl ProgressSink for LeaseKeeper {
    fn report(&self, progress: Progress) {
        self.stages().enter(&progress.stage, std::time::Instant::now());
        *self.progress.lock().unwrap_or_else(PoisonError::into_inner) = progress;
        self.has_news.store(true, Ordering::Release);
        self.news.notify_one();
    }

    fn check(&self) -> Result<(), Cancelled> {
        if self.stopped.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

impl LeaseKeeper {
    pub(super) fn starting_at(progress: Progress) -> Self {
        Self { progress: Mutex::new(progress), ..Self::default() }
    }

    /// Asks the job to stop; the first reason counts.
    pub(super) fn stop(&self, reason: StopReason) {
        let _ = self.reason.set(reason);
        self.stopped.cancel();
    }

    /// Asks the job to stop when the guard is dropped.
    pub(super) fn stop_on_drop(&self) -> DropGuard {
        self.stopped.clone().drop_guard()
    }

    /// Why the job was asked to stop, if it was.
    pub(super) fn stop_reason(&self) -> Option<StopReason> {
        self.reason.get().copied()
    }

    /// Waits until the job is asked to stop.
    pub(super) async fn stopped(&self) {
        self.stopped.cancelled().await;
    }

    /// Ends the current stage, and returns the time spent in each.
    pub(super) fn stage_times(&self) -> Vec<(&'static str, Duration)> {
        self.stages().end(std::time::Instant::now())
    }

    /// The stages so far, one by one.
    pub(super) fn visits(&self) -> Vec<Visit> {
        self.stages().visits(std::time::Instant::now())
    }

    fn stages(&self) -> MutexGuard<'_, StageTimes> {
        self.stages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn progress(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Renews the lease and stores the progress until it is dropped: it never returns. A cancellation by this process
    /// is observed at once, one by another process with the next heartbeat.
    pub(super) async fn keep(&self, deps: &Deps, config: &Config, job: &Job, abandon: &CancellationToken) {
        let mut changes = deps.store.metadata.changes();
        let mut last = Instant::now();
        // the job may have been cancelled between the claim and the subscription
        self.check_row(deps, job).await;
        loop {
            let gap = if self.has_news.load(Ordering::Acquire) { config.progress_gap } else { config.beat };
            tokio::select! {
                () = sleep_until(last + gap) => {
                    self.beat_once(deps, config.lease, job).await;
                    last = Instant::now();
                }
                () = self.news.notified() => {}
                changed = changes.recv() => match changed {
                    Ok(id) if id != job.id => {}
                    Ok(_) | Err(RecvError::Lagged(_)) => self.check_row(deps, job).await,
                    // the channel was closed: the timer above still fires
                    Err(RecvError::Closed) => changes = deps.store.metadata.changes(),
                },
                () = abandon.cancelled(), if self.stop_reason().is_none() => self.stop(StopReason::ShuttingDown),
            }
        }
    }

    /// Reads the row without renewing the lease.
    async fn check_row(&self, deps: &Deps, job: &Job) {
        match deps.store.metadata.job(job.id).await {
            Ok(Some(row)) if row.lease_token != job.lease_token => self.stop(StopReason::Lost),
            Ok(Some(row)) if row.cancel_requested => self.stop(StopReason::Cancelled),
            Ok(Some(_)) => {}
            // deleted by a client
            Ok(None) => self.stop(StopReason::Cancelled),
            Err(error) => tracing::warn!(error = ?error, "cannot read the row of a running job"),
        }
    }

    async fn beat_once(&self, deps: &Deps, lease: Duration, job: &Job) {
        self.has_news.store(false, Ordering::Release);
        let beat: StoreResult<Heartbeat> =
            deps.store.metadata.heartbeat(job.id, job.lease_token, lease, &self.progress()).await;
        match beat {
            Ok(Heartbeat::Alive) => {}
            Ok(Heartbeat::CancelRequested) => self.stop(StopReason::Cancelled),
            Ok(Heartbeat::Lost) => self.stop(StopReason::Lost),
            // the job continues: if the lease is lost meanwhile, the fencing token prevents publication
            Err(error) => tracing::warn!(error = ?error, "a heartbeat failed"),
        }
    }
}
