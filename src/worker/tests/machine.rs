//! Workers on a machine with temporary failures.

use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use crate::{
    contract::{JobError, request::JobRequest},
    jobs::{JobContext, JobOutput, JobRunner, ProgressSink},
    store::{
        Store,
        conformance::disk::{SmallDisk, TOTAL},
    },
};

const PAUSE: Duration = Duration::from_secs(60);

worker_test! {
    async fn an_error_of_the_machine_is_retried_after_a_pause() {
        let stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), Config { retry_pause: PAUSE, ..config(1) });
        let id = stage.accept().await;
        stage.order(Order::Unavailable);
        let job = stage.until(id, |job| job.state == JobState::Queued && job.attempt == 1).await;
        assert_eq!(job.error, None);
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(conformance::claim(&*stage.deps.store.metadata).await, None, "not at once");
        stage.clock.advance(PAUSE);
        let _pool = Pool::start(stage.deps.clone(), config(1));
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 2));
    }
}

worker_test! {
    async fn a_persistent_error_of_the_machine_fails_the_job_at_its_last_attempt() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        for _ in 0..3 {
            stage.order(Order::Unavailable);
        }
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Failed, 3));
        assert_eq!(job.error.unwrap().code, Code::Unavailable);
    }
}

worker_test! {
    async fn a_temporary_failure_of_the_store_does_not_fail_the_job() {
        let stage = stage().await;
        let disk = SmallDisk { failures: AtomicU64::new(2), ..SmallDisk::over(Arc::clone(&stage.deps.store.blobs), TOTAL) };
        let disk = Arc::new(disk);
        let store = Store { blobs: disk.clone(), ..stage.deps.store.clone() };
        let deps = Deps { store, ..stage.deps.clone() };
        let _pool = Pool::start(deps, config(1));
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 3));
        assert_eq!(disk.failures.load(Ordering::SeqCst), 0);
    }
}

worker_test! {
    async fn a_store_that_is_away_costs_a_job_no_attempt_however_often() {
        let stage = stage().await;
        let disk = SmallDisk { absences: AtomicU64::new(10), ..SmallDisk::over(Arc::clone(&stage.deps.store.blobs), TOTAL) };
        let store = Store { blobs: Arc::new(disk), ..stage.deps.store.clone() };
        let _pool = Pool::start(Deps { store, ..stage.deps.clone() }, config(1));
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
    }
}

/// Panics when it is asked for the memory of the first job: on the task of the worker, not on the thread of the job.
struct PanicsOnce(Arc<dyn JobRunner>, AtomicU64);

impl JobRunner for PanicsOnce {
    fn memory_need(&self, request: &JobRequest) -> u64 {
        assert!(self.1.fetch_add(1, Ordering::SeqCst) > 0, "a bug, made for the test");
        self.0.memory_need(request)
    }

    fn disk_need(&self, request: &JobRequest) -> u64 {
        self.0.disk_need(request)
    }

    fn run(&self, context: &JobContext, sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
        self.0.run(context, sink)
    }
}

worker_test! {
    async fn a_worker_that_panics_is_replaced_and_its_job_runs_again() {
        let mut stage = stage().await;
        let runner = Arc::new(PanicsOnce(Arc::clone(&stage.deps.runner), AtomicU64::new(0)));
        let pool = Pool::start(Deps { runner, ..stage.deps.clone() }, config(1));
        let alive = pool.alive();
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        while alive.load(Ordering::SeqCst) > 0 {
            tokio::task::yield_now().await;
        }
        // the lease of the lost worker expires once the new one has seen it unchanged for its whole length
        while stage.began.try_recv().is_err() {
            stage.clock.advance(LEASE);
            tokio::task::yield_now().await;
        }
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 2));
        assert_eq!(alive.load(Ordering::SeqCst), 1);
        pool.shutdown(Duration::from_secs(10)).await;
    }
}
