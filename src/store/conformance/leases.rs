//! Claims, leases and fencing.

use std::collections::BTreeSet;

use super::*;
use crate::{
    contract::{Code, JobState, Progress},
    store::{Attempt, CancelRequest, Heartbeat},
};

fn progress(completed: u32) -> Progress {
    Progress { stage: "fusing".into(), completed, total: 10, fraction: f64::from(completed) / 16.0 }
}

pub async fn jobs_are_claimed_in_the_order_of_acceptance(store: Fresh) {
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for _ in 0..3 {
        ids.push(accept(metadata, &stack()).await.id);
    }
    for id in ids {
        let claimed = claim(metadata).await.unwrap();
        assert_eq!((claimed.id, claimed.state), (id, JobState::Running));
        assert_eq!((claimed.attempt, claimed.lease_token), (1, 1));
        assert!(claimed.started_at.is_some());
    }
    assert_eq!(claim(metadata).await, None);
}

pub async fn no_job_is_claimed_twice_by_concurrent_workers(store: Fresh) {
    let mut ids = BTreeSet::new();
    for _ in 0..20 {
        ids.insert(accept(&*store.metadata, &stack()).await.id);
    }
    let claimers = (0..8).map(|_| {
        let metadata = Arc::clone(&store.metadata);
        tokio::spawn(async move {
            let mut mine = Vec::new();
            while let Some(job) = claim(&*metadata).await {
                mine.push(job.id);
            }
            mine
        })
    });
    let claimed: Vec<Uuid> =
        futures::future::join_all(claimers).await.into_iter().flat_map(|mine| mine.expect("a claimer died")).collect();
    assert_eq!(claimed.len(), 20);
    assert_eq!(claimed.into_iter().collect::<BTreeSet<_>>(), ids);
}

pub async fn a_heartbeat_renews_the_lease_and_shows_the_progress(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    for completed in 1..=4 {
        store.clock.advance(LEASE - Duration::from_secs(1));
        assert_eq!(claim(metadata).await, None, "the lease holds");
        let beat = metadata.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(completed)).await.unwrap();
        assert_eq!(beat, Heartbeat::Alive);
    }
    let seen = job(metadata, claimed.id).await;
    assert_eq!(seen.progress, progress(4));
    assert_eq!(seen.version, claimed.version + 4);
    metadata.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(4)).await.unwrap();
    assert_eq!(job(metadata, claimed.id).await.version, seen.version, "a beat without news is no change");
}

pub async fn a_worker_back_from_the_dead_cannot_publish(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let dead = claim(metadata).await.unwrap();
    store.clock.advance(LEASE);
    let living = claim(metadata).await.expect("the lease ran out");
    assert_eq!((living.id, living.attempt), (dead.id, 2));
    assert!(living.lease_token > dead.lease_token);
    assert_eq!(living.started_at, dead.started_at, "it started with its first claim");

    let beat = metadata.heartbeat(dead.id, dead.lease_token, LEASE, &progress(9)).await.unwrap();
    assert_eq!(beat, Heartbeat::Lost);
    assert!(!metadata.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert!(!metadata.release(dead.id, dead.lease_token, Attempt::NotCounted).await.unwrap());
    assert_eq!(job(metadata, dead.id).await, living, "nothing of the dead worker is to be seen");

    assert!(metadata.finish(living.id, living.lease_token, &success()).await.unwrap());
    assert!(!metadata.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert_eq!(job(metadata, living.id).await.state, JobState::Succeeded);
}

pub async fn a_late_worker_may_finish_a_job_that_was_not_claimed_again(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let slow = claim(metadata).await.unwrap();
    store.clock.advance(LEASE * 3);
    assert!(metadata.finish(slow.id, slow.lease_token, &success()).await.unwrap());
    assert_eq!(claim(metadata).await, None);
}

pub async fn a_job_that_loses_its_worker_three_times_fails_and_does_not_stall_the_queue(store: Fresh) {
    let metadata = &*store.metadata;
    let poison = accept(metadata, &stack()).await.id;
    let next = accept(metadata, &stack()).await.id;
    for attempt in 1..=ATTEMPTS {
        let claimed = claim(metadata).await.unwrap();
        assert_eq!((claimed.id, claimed.attempt), (poison, attempt));
        store.clock.advance(LEASE);
    }
    assert_eq!(claim(metadata).await.unwrap().id, next);
    let ended = job(metadata, poison).await;
    assert_eq!(ended.state, JobState::Failed);
    assert_eq!(ended.error.map(|fault| fault.code), Some(Code::WorkerLost));
    assert!(ended.finished_at.is_some());
}

pub async fn a_released_job_is_queued_again_and_the_attempt_does_not_count(store: Fresh) {
    let metadata = &*store.metadata;
    let id = accept(metadata, &stack()).await.id;
    for _ in 0..=ATTEMPTS {
        let claimed = claim(metadata).await.unwrap();
        assert_eq!((claimed.id, claimed.attempt), (id, 1));
        metadata.heartbeat(id, claimed.lease_token, LEASE, &progress(3)).await.unwrap();
        assert!(metadata.release(id, claimed.lease_token, Attempt::NotCounted).await.unwrap());
        let waiting = job(metadata, id).await;
        assert_eq!((waiting.state, waiting.progress.fraction), (JobState::Queued, 0.0));
        assert!(
            !metadata.finish(id, claimed.lease_token, &success()).await.unwrap(),
            "the lease went with the release"
        );
    }
}

pub async fn a_cancel_reaches_the_worker_and_survives_its_death(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    assert_eq!(metadata.cancel(claimed.id).await.unwrap(), Some(CancelRequest::Requested));
    assert!(job(metadata, claimed.id).await.cancel_requested);
    let beat = metadata.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(1)).await.unwrap();
    assert_eq!(beat, Heartbeat::CancelRequested);
    store.clock.advance(LEASE);
    assert_eq!(claim(metadata).await, None, "a cancelled job is not tried again");
    assert_eq!(job(metadata, claimed.id).await.state, JobState::Cancelled);
}

pub async fn a_job_of_a_lost_worker_is_cancelled_at_once(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let dead = claim(metadata).await.unwrap();
    store.clock.advance(LEASE);
    assert_eq!(metadata.cancel(dead.id).await.unwrap(), Some(CancelRequest::Cancelled));
    assert!(!metadata.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert_eq!(job(metadata, dead.id).await.state, JobState::Cancelled);
}

pub async fn a_released_job_with_a_pending_cancellation_ends(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    accept(metadata, &stack()).await;
    let (cancelled, deleted) = (claim(metadata).await.unwrap(), claim(metadata).await.unwrap());
    metadata.cancel(cancelled.id).await.unwrap();
    metadata.delete_job(deleted.id).await.unwrap();
    assert!(metadata.release(cancelled.id, cancelled.lease_token, Attempt::NotCounted).await.unwrap());
    assert!(metadata.release(deleted.id, deleted.lease_token, Attempt::NotCounted).await.unwrap());
    assert_eq!(job(metadata, cancelled.id).await.state, JobState::Cancelled);
    assert_eq!(metadata.blob_owner(deleted.id).await.unwrap(), None);
    assert_eq!(claim(metadata).await, None);
}

pub async fn a_deleted_job_of_a_lost_worker_is_removed_by_the_next_claim(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let dead = claim(metadata).await.unwrap();
    assert!(metadata.delete_job(dead.id).await.unwrap());
    store.clock.advance(LEASE);
    assert_eq!(claim(metadata).await, None);
    assert_eq!(metadata.blob_owner(dead.id).await.unwrap(), None);
}

pub async fn a_clock_that_jumps_forward_takes_no_job_from_a_living_worker(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    store.clock.advance(Duration::from_secs(1));
    store.clock.set_wall_by(10 * 365 * 24 * 60 * 60 * 1000);
    assert_eq!(claim(metadata).await, None, "it was heard of a second ago");
    metadata.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(1)).await.unwrap();
    store.clock.advance(LEASE - Duration::from_secs(1));
    assert_eq!(claim(metadata).await, None, "the lease holds");
    assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
}

pub async fn a_clock_that_jumps_back_keeps_no_job_with_a_dead_worker(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let dead = claim(metadata).await.unwrap();
    store.clock.set_wall_by(-10 * 365 * 24 * 60 * 60 * 1000);
    assert_eq!(claim(metadata).await, None);
    store.clock.advance(LEASE);
    let living = claim(metadata).await.expect("nothing was heard of its worker for a whole lease");
    assert_eq!((living.id, living.attempt), (dead.id, 2));
}

pub async fn a_lease_expires_by_its_own_length(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let long = LEASE * 100;
    let claimed = metadata.claim(long, ATTEMPTS, None).await.unwrap().unwrap();
    store.clock.advance(LEASE * 50);
    assert_eq!(claim(metadata).await, None, "it is held for a hundred times as long");
    metadata.heartbeat(claimed.id, claimed.lease_token, long, &progress(1)).await.unwrap();
    assert_eq!(claim(metadata).await, None, "the heartbeat is seen");
    store.clock.advance(LEASE * 99);
    assert_eq!(claim(metadata).await, None);
    store.clock.advance(LEASE);
    assert_eq!(claim(metadata).await.map(|job| job.id), Some(claimed.id), "nothing was heard of it for all that time");
}

pub async fn a_job_released_with_a_pause_is_not_claimed_before_it_is_over(store: Fresh) {
    let metadata = &*store.metadata;
    let pause = Duration::from_secs(60);
    let (paused, next) = (accept(metadata, &stack()).await.id, accept(metadata, &stack()).await.id);
    let claimed = claim(metadata).await.unwrap();
    assert!(metadata.release(paused, claimed.lease_token, Attempt::Counted { pause }).await.unwrap());
    assert_eq!(job(metadata, paused).await.attempt, 1, "it counts");
    let claimed = claim(metadata).await.expect("the queue continues");
    assert_eq!(claimed.id, next);
    assert!(metadata.finish(next, claimed.lease_token, &success()).await.unwrap());
    store.clock.advance(pause - Duration::from_secs(1));
    assert_eq!(claim(metadata).await, None);
    store.clock.advance(Duration::from_secs(1));
    let claimed = claim(metadata).await.expect("the pause is over");
    assert_eq!((claimed.id, claimed.attempt), (paused, 2));
    // a pause for which the job is not the reason
    assert!(metadata.release(paused, claimed.lease_token, Attempt::Postponed { pause }).await.unwrap());
    assert_eq!(job(metadata, paused).await.attempt, 1, "it does not count");
    assert_eq!(claim(metadata).await, None);
    store.clock.advance(pause);
    assert_eq!(claim(metadata).await.map(|job| job.attempt), Some(2));
}
