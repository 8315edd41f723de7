//! The workers of one process.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Duration,
};

use tokio::{
    sync::{Mutex, Semaphore},
    task::JoinSet,
    time::timeout,
};
use tokio_util::sync::CancellationToken;

use super::{Config, Deps, executor::Executor};
use crate::{contract::JobKind, store::Job, supervision::supervised, telemetry::events};

/// Time that jobs may take to stop when they are asked to.
const STOP_TIMEOUT: Duration = Duration::from_secs(10);

/// Running workers. Dropping the pool aborts them at once, like a crash; [`Pool::shutdown`] ends them gracefully.
pub struct Pool {
    tasks: JoinSet<()>,
    stop: CancellationToken,
    executor: Arc<Executor>,
    alive: Arc<AtomicUsize>,
}

impl Pool {
    /// Starts the workers. One that panics is started again; its job runs again once its lease has expired.
    pub fn start(deps: Deps, config: Config) -> Self {
        let stop = CancellationToken::new();
        let workers = config.workers;
        events::pool_started(config.memory_budget);
        let mut executor =
            Executor { deps, config, memory: Arc::new(Semaphore::new(0)), abandon: CancellationToken::new() };
        executor.memory = Arc::new(Semaphore::new(executor.whole_budget() as usize));
        let executor = Arc::new(executor);
        let gate = Arc::new(Mutex::new(()));
        let alive = Arc::new(AtomicUsize::new(workers));
        let mut tasks = JoinSet::new();
        for _ in 0..workers {
            let (executor, gate, stop) = (Arc::clone(&executor), Arc::clone(&gate), stop.clone());
            let (alive, was_started) = (Arc::clone(&alive), AtomicBool::new(false));
            tasks.spawn(supervised("worker", move || {
                if was_started.swap(true, Ordering::Relaxed) {
                    alive.fetch_add(1, Ordering::Relaxed);
                }
                let alive = Alive { count: Arc::clone(&alive), _gauge: events::alive() };
                work(Arc::clone(&executor), Arc::clone(&gate), stop.clone(), alive)
            }));
        }
        Self { tasks, stop, executor, alive }
    }

    /// The number of workers that are alive, now and later: between a panic and the next start a worker is not.
    pub fn alive(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.alive)
    }

    /// Claims no more jobs, waits up to `grace` for running jobs, and returns the others to the queue.
    pub async fn shutdown(mut self, grace: Duration) {
        self.stop.cancel();
        if timeout(grace, drain(&mut self.tasks)).await.is_ok() {
            return;
        }
        self.executor.abandon.cancel();
        if timeout(STOP_TIMEOUT, drain(&mut self.tasks)).await.is_err() {
            tracing::warn!("jobs did not stop in time; they run again once their leases have expired");
        }
    }
}

async fn drain(tasks: &mut JoinSet<()>) {
    while tasks.join_next().await.is_some() {}
}

/// Counts a worker as alive until it is dropped.
struct Alive {
    count: Arc<AtomicUsize>,
    _gauge: events::Held,
}

impl Drop for Alive {
    fn drop(&mut self) {
        self.count.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Counts the start of a job: the time that it waited for its first attempt, or a retry.
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

/// One worker. The worker that holds the gate claims a job; the others run jobs or wait for the gate.
async fn work(executor: Arc<Executor>, gate: Arc<Mutex<()>>, stop: CancellationToken, _alive: Alive) {
    let Executor { deps, config, .. } = &*executor;
    // such jobs wait for a worker that has the program
    let except = Some(JobKind::Reconstruction).filter(|kind| !deps.runner.runs(*kind));
    loop {
        let gate = tokio::select! {
            biased;
            () = stop.cancelled() => return,
            gate = Arc::clone(&gate).lock_owned() => gate,
        };
        // subscribed before the claim, so that no new job is missed between the two
        let mut arrivals = deps.store.metadata.arrivals();
        let claimed = deps.store.metadata.claim(config.lease, config.max_attempts, except).await;
        match claimed {
            Ok(Some(job)) => {
                count_start(&job);
                executor.run_claimed_job(job, gate).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(?error, "cannot claim a job"),
        }
        tokio::select! {
            () = stop.cancelled() => return,
            _ = timeout(config.poll, arrivals.recv()) => {}
        }
    }
}
