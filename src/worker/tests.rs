//! Workers on a real store with scripted jobs: they wait for messages of the test, never for time.

mod fixture;
mod scripted;

use super::*;
use crate::{
    contract::{Code, JobState},
    store::{
        Job,
        blobs::result_key,
        conformance::{self, LEASE, line::Line, memory::MemoryBlobStore},
        gc::{delete_blobs, jobs_with_blobs},
        open_with_clock,
    },
};
use fixture::{config, stage, stage_with_need, stage_with_needs};
use scripted::Order;

macro_rules! worker_test {
    (async fn $name:ident() $body:block) => {
        #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $name() {
            let test = async $body;
            tokio::time::timeout(Duration::from_secs(60), test).await.expect("the test hangs");
        }
    };
}

// after the macro, which they use
mod disk;
mod leases;
mod machine;
mod science;

worker_test! {
    async fn a_job_runs_and_its_files_are_published() {
        let stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(2));
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
        assert_eq!(stage.results_of(&job).await.as_deref(), Some(&b"the archive"[..]));
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(stage.scratch_folders(), 0, "nothing is left in the workspace");
    }
}

worker_test! {
    async fn a_job_runs_on_blobs_that_are_not_local_files() {
        let mut stage = stage().await;
        stage.deps.store = MemoryBlobStore::under(stage.deps.store);
        stage.deps.disk = DiskBudget::new(&stage.deps.store, 0);
        let pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!(stage.results_of(&job).await.as_deref(), Some(&b"the archive"[..]));
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(stage.scratch_folders(), 0, "the copy of the upload is removed");
    }
}

worker_test! {
    async fn progress_is_stored_while_the_job_runs() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        for fraction in [0.25, 0.5] {
            stage.order(Order::Report(fraction));
            let job = stage.until(id, |job| job.progress.fraction >= fraction).await;
            assert_eq!((job.state, job.progress.stage.as_str()), (JobState::Running, "fusing"));
        }
        stage.order(Order::Succeed);
        stage.ended(id).await;
    }
}

worker_test! {
    async fn a_job_that_fails_or_panics_does_not_kill_its_worker() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let mut codes = Vec::new();
        for order in [Order::Panic, Order::Fail] {
            let id = stage.accept().await;
            stage.order(order);
            let job = stage.ended(id).await;
            assert_eq!(job.state, JobState::Failed);
            codes.push(job.error.unwrap().code);
        }
        assert_eq!(codes, [Code::Internal, Code::InvalidImage]);
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn a_job_larger_than_the_whole_budget_runs_alone_and_others_wait() {
        let mut stage = stage_with_need(100 << 30).await;
        let _pool = Pool::start(stage.deps.clone(), config(2));
        let (first, second) = (stage.accept().await, stage.accept().await);
        assert_eq!(stage.began.recv().await, Some(first));
        // the second is claimed and sends heartbeats, but has no memory yet: its cancellation must be observed all the
        // same
        stage.until(second, |job| job.state == JobState::Running).await;
        assert!(stage.began.try_recv().is_err());
        stage.deps.store.metadata.cancel(second).await.unwrap();
        assert_eq!(stage.ended(second).await.state, JobState::Cancelled);
        let third = stage.accept().await;
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(first).await.state, JobState::Succeeded);
        assert_eq!(stage.began.recv().await, Some(third));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(third).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn small_jobs_run_side_by_side() {
        let mut stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(2));
        let (first, second) = (stage.accept().await, stage.accept().await);
        let mut began = [stage.began.recv().await.unwrap(), stage.began.recv().await.unwrap()];
        began.sort();
        let mut both = [first, second];
        both.sort();
        assert_eq!(began, both);
        stage.order(Order::Succeed);
        stage.order(Order::Succeed);
        for id in both {
            assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
        }
    }
}

worker_test! {
    async fn a_job_that_lost_a_worker_runs_alone() {
        let mut stage = stage().await;
        let (suspect, innocent) = (stage.accept().await, stage.accept().await);
        // a worker takes the first job and dies
        conformance::claim(&*stage.deps.store.metadata).await.expect("the suspect");
        stage.clock.advance(LEASE);
        let _pool = Pool::start(stage.deps.clone(), config(2));
        assert_eq!(stage.began.recv().await, Some(suspect));
        stage.order(Order::Report(0.5));
        stage.until(suspect, |job| job.progress.fraction == 0.5).await;
        assert_eq!(conformance::job(&*stage.deps.store.metadata, innocent).await.state, JobState::Queued);
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(suspect).await.attempt, 2);
        assert_eq!(stage.began.recv().await, Some(innocent));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(innocent).await.attempt, 1);
    }
}

worker_test! {
    async fn a_job_whose_upload_is_missing_fails_with_an_explanation() {
        let stage = stage().await;
        let id = stage.accept().await;
        delete_blobs(&*stage.deps.store.blobs, id).await.unwrap();
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let job = stage.ended(id).await;
        assert_eq!(job.state, JobState::Failed);
        assert!(job.error.unwrap().detail.contains("upload"));
    }
}
