//! Workers on a machine with temporary failures.

use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use crate::store::{
    Store,
    conformance::disk::{SmallDisk, TOTAL},
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
