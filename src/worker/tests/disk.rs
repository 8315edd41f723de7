//! Workers on a full disk.

use std::sync::atomic::Ordering;

use super::*;
use crate::{
    disk_budget::DiskBudget,
    store::{Store, conformance::disk::SmallDisk},
};

worker_test! {
    async fn a_job_that_fills_the_disk_is_retried_a_limited_number_of_times() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        stage.order(Order::Full);
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 2));
        let id = stage.accept().await;
        for _ in 0..3 {
            stage.order(Order::Full);
        }
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Failed, 3));
        assert_eq!(job.error.unwrap().code, Code::InsufficientStorage);
    }
}

worker_test! {
    async fn a_job_that_could_never_fit_on_the_disk_fails_with_figures() {
        let stage = stage_with_needs(1, u64::MAX).await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let job = stage.ended(stage.accept().await).await;
        let error = job.error.expect("it failed");
        assert_eq!(error.code, Code::InsufficientStorage);
        assert!(error.detail.contains(&u64::MAX.to_string()), "{}", error.detail);
    }
}

worker_test! {
    async fn a_job_that_needs_more_memory_than_the_container_has_fails_with_figures() {
        let stage = stage_with_needs(3 << 20, 1).await;
        let _pool = Pool::start(stage.deps.clone(), Config { memory_limit: Some(2 << 20), ..config(1) });
        let job = stage.ended(stage.accept().await).await;
        let error = job.error.expect("it failed");
        assert_eq!((error.code, job.attempt), (Code::InsufficientStorage, 1));
        assert!(error.detail.contains("3 MiB") && error.detail.contains("2 MiB"), "{}", error.detail);
    }
}

worker_test! {
    async fn a_job_waits_for_disk_space_and_can_be_cancelled_meanwhile() {
        let stage = stage_with_needs(1, 1).await;
        let full = Arc::new(SmallDisk::over(Arc::clone(&stage.deps.store.blobs), 0));
        let small = Store { blobs: full.clone(), ..stage.deps.store.clone() };
        let deps = Deps { disk: DiskBudget::new(&small, 0), ..stage.deps.clone() };
        let _pool = Pool::start(deps, config(1));
        let (cancelled, waiting) = (stage.accept().await, stage.accept().await);
        let waits = |job: &Job| job.state == JobState::Running && job.progress.stage.contains("disk space");
        stage.until(cancelled, waits).await;
        stage.deps.store.metadata.cancel(cancelled).await.unwrap();
        assert_eq!(stage.ended(cancelled).await.state, JobState::Cancelled);
        stage.until(waiting, waits).await;
        full.free.store(1, Ordering::SeqCst);
        stage.order(Order::Succeed);
        let job = stage.ended(waiting).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
    }
}

worker_test! {
    async fn a_job_waits_for_disk_space_that_an_upload_reserved() {
        let stage = stage_with_needs(1, 600).await;
        let disk = Arc::new(SmallDisk::over(Arc::clone(&stage.deps.store.blobs), 1000));
        let small = Store { blobs: disk, ..stage.deps.store.clone() };
        let deps = Deps { disk: DiskBudget::new(&small, 0), ..stage.deps.clone() };
        let upload = deps.disk.reserve(500).await.unwrap().granted().expect("an upload is first");
        let _pool = Pool::start(deps.clone(), config(1));
        let id = stage.accept().await;
        stage.until(id, |job| job.progress.stage.contains("disk space")).await;
        drop(upload);
        stage.order(Order::Report(0.5));
        stage.until(id, |job| job.progress.fraction == 0.5).await;
        assert!(deps.disk.reserve(500).await.unwrap().granted().is_err(), "an upload sees what the job reserved");
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
    }
}
