//! The workers of one process.

use std::{sync::Arc, time::Duration};

use tokio::{
    sync::{Mutex, Semaphore},
    task::JoinSet,
    time::timeout,
};
use tokio_util::sync::CancellationToken;

use super::{Config, Deps, attend::Shared};
use crate::{store::Job, telemetry::events};

/// How long jobs that were told to stop may take to see it.
const LET_GO: Duration = Duration::from_secs(10);

/// Running workers. Dropping it stops them at once, as a crash would; [`Pool::shutdown`] is the polite way.
pub struct Pool {
    tasks: JoinSet<()>,
    stop: CancellationToken,
    shared: Arc<Shared>,
}

impl Pool {
    /// Starts the workers.
    pub fn start(deps: Deps, config: Config) -> Self {
        let stop = CancellationToken::new();
        let workers = config.workers;
        events::pool_started(workers, config.memory_budget);
        let mut shared =
            Shared { deps, config, memory: Arc::new(Semaphore::new(0)), abandon: CancellationToken::new() };
        shared.memory = Arc::new(Semaphore::new(shared.whole_budget() as usize));
        let shared = Arc::new(shared);
        let gate = Arc::new(Mutex::new(()));
        let mut tasks = JoinSet::new();
        for _ in 0..workers {
            tasks.spawn(work(Arc::clone(&shared), Arc::clone(&gate), stop.clone()));
        }
        Self { tasks, stop, shared }
    }

    /// Takes no new jobs, lets running ones end within `grace`, and gives the rest back to the queue.
    pub async fn shutdown(mut self, grace: Duration) {
        self.stop.cancel();
        if timeout(grace, drain(&mut self.tasks)).await.is_ok() {
            return;
        }
        self.shared.abandon.cancel();
        if timeout(LET_GO, drain(&mut self.tasks)).await.is_err() {
            tracing::warn!("jobs did not let go in time; they are done again once their leases have run out");
        }
    }
}

async fn drain(tasks: &mut JoinSet<()>) {
    while let Some(ended) = tasks.join_next().await {
        if let Err(error) = ended {
            tracing::error!(%error, "a worker died");
        }
    }
}

/// Tells how long a job waited for its first attempt, or that it is not the first.
fn count_start(job: &Job) {
    let kind = job.request.kind();
    match job.started_at {
        Some(started) if job.attempt == 1 => {
            let waited = Duration::try_from(started.duration_since(job.created_at)).unwrap_or_default();
            events::started(kind, waited);
        }
        _ => events::retried(kind),
    }
}

/// One worker. Whoever holds the gate looks for a job; the others work or wait for the gate.
async fn work(shared: Arc<Shared>, gate: Arc<Mutex<()>>, stop: CancellationToken) {
    let Shared { deps, config, .. } = &*shared;
    loop {
        let gate = tokio::select! {
            biased;
            () = stop.cancelled() => return,
            gate = Arc::clone(&gate).lock_owned() => gate,
        };
        // subscribed before the look, so that no job slips in between
        let mut changes = deps.rows.changes();
        let claimed = deps.rows.claim(config.lease, config.max_attempts).await;
        match claimed {
            Ok(Some(job)) => {
                tracing::info!(job = %job.id, kind = ?job.request.kind(), attempt = job.attempt, "job claimed");
                count_start(&job);
                shared.attend(job, gate).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(?error, "cannot look for a job"),
        }
        tokio::select! {
            () = stop.cancelled() => return,
            _ = timeout(config.poll, changes.recv()) => {}
        }
    }
}
