//! The line between a job on its thread and the heartbeat that speaks for it.

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

use super::{Config, Deps, stages::StageTimes};
use crate::{
    contract::Progress,
    jobs::ProgressSink,
    store::{Heartbeat, Job, StoreResult},
};
use pinstack_science::types::Cancelled;

/// Why a job is told to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    /// A client asked for it.
    Cancelled,
    /// The lease is another worker's.
    Lost,
    /// The process goes down; the job goes back to the queue.
    ShuttingDown,
}

/// One per claimed job.
#[derive(Default)]
pub(super) struct Lifeline {
    progress: Mutex<Progress>,
    stages: Mutex<StageTimes>,
    has_news: AtomicBool,
    news: Notify,
    why: OnceLock<Why>,
    stopped: CancellationToken,
}

impl ProgressSink for Lifeline {
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

impl Lifeline {
    pub(super) fn starting_at(progress: Progress) -> Self {
        Self { progress: Mutex::new(progress), ..Self::default() }
    }

    /// Tells the job to stop; the first reason stays.
    pub(super) fn stop(&self, why: Why) {
        let _ = self.why.set(why);
        self.stopped.cancel();
    }

    /// Tells the job to stop when the guard goes.
    pub(super) fn stop_on_drop(&self) -> DropGuard {
        self.stopped.clone().drop_guard()
    }

    /// Why the job was told to stop, when it was.
    pub(super) fn why(&self) -> Option<Why> {
        self.why.get().copied()
    }

    /// Waits until the job is told to stop.
    pub(super) async fn stopped(&self) {
        self.stopped.cancelled().await;
    }

    /// The stages of the job and the time spent in each; for the end of the job.
    pub(super) fn stage_times(&self) -> Vec<(&'static str, Duration)> {
        self.stages().end(std::time::Instant::now())
    }

    fn stages(&self) -> MutexGuard<'_, StageTimes> {
        self.stages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn progress(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Renews the lease and brings the progress, until it is dropped: never returns by itself. Sees a cancel at once when
    /// this process was asked for it, within a beat when another was.
    pub(super) async fn beat(&self, deps: &Deps, config: &Config, job: &Job, abandon: &CancellationToken) {
        let mut changes = deps.rows.changes();
        let mut last = Instant::now();
        // a cancel may have come between the claim and the subscription
        self.look(deps, job).await;
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
                    Ok(_) | Err(RecvError::Lagged(_)) => self.look(deps, job).await,
                    // the store went away: the clock above still beats
                    Err(RecvError::Closed) => changes = deps.rows.changes(),
                },
                () = abandon.cancelled(), if self.why().is_none() => self.stop(Why::ShuttingDown),
            }
        }
    }

    /// Looks at the row without touching it.
    async fn look(&self, deps: &Deps, job: &Job) {
        match deps.rows.job(job.id).await {
            Ok(Some(row)) if row.lease_token != job.lease_token => self.stop(Why::Lost),
            Ok(Some(row)) if row.cancel_requested => self.stop(Why::Cancelled),
            Ok(Some(_)) => {}
            // deleted by a client
            Ok(None) => self.stop(Why::Cancelled),
            Err(error) => tracing::warn!(job = %job.id, error = ?error, "cannot look at a running job"),
        }
    }

    async fn beat_once(&self, deps: &Deps, lease: Duration, job: &Job) {
        self.has_news.store(false, Ordering::Release);
        let beat: StoreResult<Heartbeat> = deps.rows.heartbeat(job.id, job.lease_token, lease, &self.progress()).await;
        match beat {
            Ok(Heartbeat::Alive) => {}
            Ok(Heartbeat::CancelRequested) => self.stop(Why::Cancelled),
            Ok(Heartbeat::Lost) => self.stop(Why::Lost),
            // The job goes on: if the lease is lost meanwhile, the fence stops its result.
            Err(error) => tracing::warn!(job = %job.id, error = ?error, "a heartbeat failed"),
        }
    }
}
