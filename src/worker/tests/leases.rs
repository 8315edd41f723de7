//! Workers that lose a job: to a cancellation, to another worker, to a shutdown.

use super::*;

worker_test! {
    async fn a_cancel_stops_a_running_job() {
        let mut stage = stage().await;
        // one heartbeat per hour: the cancellation must arrive by the notification within the process
        let hourly = Duration::from_secs(3600);
        let pool = Pool::start(stage.deps.clone(), Config { beat: hourly, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        stage.deps.store.metadata.cancel(id).await.unwrap();
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.outcome.is_none()), (JobState::Cancelled, true));
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(stage.scratch_folders(), 0);
    }
}

worker_test! {
    async fn a_job_whose_zip_is_still_on_its_way_stops_at_once() {
        let mut stage = stage().await;
        // the copy of a zip takes an hour
        stage.deps.store = MemoryBlobStore::behind(Line::new(1e9, Duration::from_secs(3600)), stage.deps.store);
        stage.deps.disk = DiskBudget::new(&stage.deps.store, 0);
        let pool = Pool::start(stage.deps.clone(), config(1));
        let is_copying = |job: &Job| job.state == JobState::Running && job.progress.stage == "reading";
        let cancelled = stage.accept().await;
        stage.until(cancelled, is_copying).await;
        stage.deps.store.metadata.cancel(cancelled).await.unwrap();
        assert_eq!(stage.ended(cancelled).await.state, JobState::Cancelled);
        let released = stage.accept().await;
        stage.until(released, is_copying).await;
        pool.shutdown(Duration::ZERO).await;
        let job = conformance::job(&*stage.deps.store.metadata, released).await;
        assert_eq!((job.state, job.attempt), (JobState::Queued, 0));
        assert!(stage.began.try_recv().is_err(), "neither began");
        assert_eq!(stage.scratch_folders(), 0, "the incomplete copies are removed");
        assert_eq!(stage.deps.disk.reserved(), 0, "and the space for them is returned");
    }
}

worker_test! {
    async fn a_cancel_by_another_process_is_observed_with_the_next_heartbeat() {
        let mut stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        let other = open_with_clock(stage.folder.path(), stage.clock.clone()).await.unwrap().metadata;
        other.cancel(id).await.unwrap();
        assert_eq!(stage.ended(id).await.state, JobState::Cancelled);
    }
}

worker_test! {
    async fn a_running_job_that_is_deleted_stops_and_leaves_nothing() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        assert!(stage.deps.store.metadata.delete_job(id).await.unwrap());
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(stage.deps.store.metadata.blob_owner(id).await.unwrap(), None);
        assert!(jobs_with_blobs(&*stage.deps.store.blobs).await.unwrap().is_empty());
    }
}

worker_test! {
    async fn a_worker_that_lost_its_lease_stops_and_publishes_nothing() {
        let mut stage = stage().await;
        // one heartbeat at the start, then none, like a process that was stopped
        let asleep = Duration::from_secs(3600);
        let pool = Pool::start(stage.deps.clone(), Config { beat: asleep, poll: asleep, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        // another process claims the job when the lease has expired, and ends it
        let other = open_with_clock(stage.folder.path(), stage.clock.clone()).await.unwrap().metadata;
        let taken = conformance::claim_from_the_dead(&*other, &stage.clock).await;
        assert_eq!((taken.id, taken.lease_token), (id, 2));
        stage.order(Order::Succeed); // the first worker continues and has a result
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(conformance::job(&*other, id).await, taken, "it published nothing");
        let stale = stage.deps.store.blobs.head(&result_key(id, 1, "image.png")).await.unwrap();
        assert_eq!(stale, None, "and its files are removed");
        assert!(other.finish(id, 2, &conformance::success()).await.unwrap());
    }
}

worker_test! {
    async fn a_lost_lease_stops_the_job_with_the_next_heartbeat() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), Config { workers: 1, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        let other = open_with_clock(stage.folder.path(), stage.clock.clone()).await.unwrap().metadata;
        // the lease must expire and be claimed between two heartbeats
        let taken = loop {
            // observed by the other process, then unchanged for a whole lease
            if let Some(taken) = other.claim(LEASE, 1000, None).await.unwrap() {
                break taken;
            }
            stage.clock.advance(LEASE);
        };
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(conformance::job(&*other, id).await.lease_token, taken.lease_token);
    }
}

worker_test! {
    async fn a_shutdown_returns_unfinished_jobs_without_counting_the_attempt() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        pool.shutdown(Duration::ZERO).await;
        let job = conformance::job(&*stage.deps.store.metadata, id).await;
        assert_eq!((job.state, job.attempt), (JobState::Queued, 0));
        let _pool = Pool::start(stage.deps.clone(), config(1));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn a_shutdown_lets_running_jobs_end_and_takes_no_new_ones() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let (running, waiting) = (stage.accept().await, stage.accept().await);
        assert_eq!(stage.began.recv().await, Some(running));
        let shutdown = tokio::spawn(pool.shutdown(Duration::from_secs(60)));
        stage.order(Order::Succeed);
        shutdown.await.unwrap();
        assert_eq!(conformance::job(&*stage.deps.store.metadata, running).await.state, JobState::Succeeded);
        assert_eq!(conformance::job(&*stage.deps.store.metadata, waiting).await.state, JobState::Queued);
    }
}
