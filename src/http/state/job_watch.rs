//! Waits for changes of jobs on behalf of all requests of a process.
//!
//! A change that this process made is announced by the store at once. Changes by other processes are found by polling:
//! one query per interval for all jobs that requests wait for, however many requests there are.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use futures::future::BoxFuture;
use tokio::{
    sync::{
        Notify,
        broadcast::{Receiver, error::RecvError},
    },
    time::sleep,
};
use uuid::Uuid;

use crate::{
    store::{MetadataStore, StoreResult},
    supervision::supervised,
};

/// Reads the versions of jobs, as [`JobQueue::versions`](crate::store::JobQueue::versions) does.
type ReadVersions = Box<dyn Fn(Vec<Uuid>) -> BoxFuture<'static, StoreResult<Vec<(Uuid, i64)>>> + Send + Sync>;

/// The jobs that requests of this process wait for.
pub struct JobWatch {
    read: ReadVersions,
    interval: Duration,
    waiters: Mutex<Waiters>,
}

#[derive(Default)]
struct Waiters {
    next_ticket: u64,
    by_ticket: HashMap<u64, Waiter>,
    /// A task polls. It ends when nothing waits any more.
    is_polled: bool,
}

/// A request that waits.
struct Waiter {
    job: Uuid,
    /// The version that the request knows.
    version: i64,
    changed: Arc<Notify>,
}

impl JobWatch {
    /// A watch over the jobs of a store, which polls every `interval` while something waits.
    pub fn new(metadata: Arc<dyn MetadataStore>, interval: Duration) -> Arc<Self> {
        let read: ReadVersions = Box::new(move |jobs| {
            let metadata = Arc::clone(&metadata);
            Box::pin(async move { metadata.versions(&jobs).await })
        });
        Self::reading(read, interval)
    }

    fn reading(read: ReadVersions, interval: Duration) -> Arc<Self> {
        Arc::new(Self { read, interval, waiters: Mutex::default() })
    }

    /// Returns when the job may have another version than `version`. `changes` is a receiver of
    /// [`MetadataStore::changes`] that was made before that version was read.
    pub async fn changed(self: &Arc<Self>, changes: &mut Receiver<Uuid>, job: Uuid, version: i64) {
        let ticket = Ticket::new(self, job, version);
        loop {
            tokio::select! {
                change = changes.recv() => match change {
                    Ok(changed) if changed != job => {}
                    // some reports were missed, perhaps one of this job
                    Ok(_) | Err(RecvError::Lagged(_)) => return,
                    Err(RecvError::Closed) => return ticket.changed.notified().await,
                },
                () = ticket.changed.notified() => return,
            }
        }
    }

    fn waiters(&self) -> MutexGuard<'_, Waiters> {
        self.waiters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Polls until nothing waits.
    async fn poll(self: Arc<Self>) {
        loop {
            sleep(self.interval).await;
            let mut jobs: Vec<Uuid> = {
                let mut waiters = self.waiters();
                if waiters.by_ticket.is_empty() {
                    waiters.is_polled = false;
                    return;
                }
                waiters.by_ticket.values().map(|waiter| waiter.job).collect()
            };
            jobs.sort_unstable();
            jobs.dedup();
            let versions = (self.read)(jobs.clone()).await.map(HashMap::<Uuid, i64>::from_iter);
            for waiter in self.waiters().by_ticket.values() {
                // when the store cannot be read, each request reads its job itself and answers accordingly
                let is_current = versions.as_ref().is_ok_and(|found| found.get(&waiter.job) == Some(&waiter.version));
                // a job that began to wait after the query is asked for in the next one
                if !is_current && (versions.is_err() || jobs.binary_search(&waiter.job).is_ok()) {
                    waiter.changed.notify_one();
                }
            }
        }
    }
}

/// The entry of a request among the waiters; removed when it is dropped.
struct Ticket {
    watch: Arc<JobWatch>,
    number: u64,
    changed: Arc<Notify>,
}

impl Ticket {
    fn new(watch: &Arc<JobWatch>, job: Uuid, version: i64) -> Self {
        let changed = Arc::new(Notify::new());
        let mut waiters = watch.waiters();
        let number = waiters.next_ticket;
        waiters.next_ticket += 1;
        waiters.by_ticket.insert(number, Waiter { job, version, changed: Arc::clone(&changed) });
        if !std::mem::replace(&mut waiters.is_polled, true) {
            #[expect(clippy::disallowed_methods, reason = "it polls for all requests and belongs to none")]
            tokio::spawn(supervised("poll of jobs", {
                let watch = Arc::clone(watch);
                move || Arc::clone(&watch).poll()
            }));
        }
        drop(waiters);
        Self { watch: Arc::clone(watch), number, changed }
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.watch.waiters().by_ticket.remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::future::join_all;
    use tokio::sync::broadcast;

    use super::*;

    #[tokio::test]
    async fn however_many_requests_wait_each_poll_is_one_query() {
        let queries = Arc::new(AtomicUsize::new(0));
        let jobs: Vec<Uuid> = (0..500).map(Uuid::from_u128).collect();
        let counted = Arc::clone(&queries);
        // another process changes all jobs after the second poll
        let read: ReadVersions = Box::new(move |asked| {
            let version = if counted.fetch_add(1, Ordering::Relaxed) < 2 { 1 } else { 2 };
            Box::pin(async move { Ok(asked.into_iter().map(|job| (job, version)).collect()) })
        });
        let watch = JobWatch::reading(read, Duration::from_millis(1));
        let (sender, _) = broadcast::channel(1);
        join_all(jobs.iter().map(|job| {
            let (watch, mut changes) = (Arc::clone(&watch), sender.subscribe());
            async move { watch.changed(&mut changes, *job, 1).await }
        }))
        .await;
        assert_eq!(queries.load(Ordering::Relaxed), 3);
        assert!(watch.waiters().by_ticket.is_empty(), "nothing is left of a request that waited");
    }
}
