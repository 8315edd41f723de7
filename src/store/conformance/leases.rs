//! Claims, leases and the fence.

use std::collections::BTreeSet;

use super::*;
use crate::{
    contract::{Code, JobState, Progress},
    store::{Attempt, CancelRequest, Heartbeat},
};

fn progress(completed: u32) -> Progress {
    Progress { stage: "fusing".into(), completed, total: 10, fraction: f64::from(completed) / 16.0 }
}

pub(crate) async fn jobs_are_claimed_in_the_order_of_acceptance(store: Fresh) {
    let rows = &*store.rows;
    let mut ids = Vec::new();
    for _ in 0..3 {
        ids.push(accept(rows, &stack()).await.id);
    }
    for id in ids {
        let claimed = claim(rows).await.unwrap();
        assert_eq!((claimed.id, claimed.state), (id, JobState::Running));
        assert_eq!((claimed.attempt, claimed.lease_token), (1, 1));
        assert!(claimed.started_at.is_some());
    }
    assert_eq!(claim(rows).await, None);
}

pub(crate) async fn no_job_is_claimed_twice_however_many_claim_at_once(store: Fresh) {
    let mut ids = BTreeSet::new();
    for _ in 0..20 {
        ids.insert(accept(&*store.rows, &stack()).await.id);
    }
    let claimers = (0..8).map(|_| {
        let rows = Arc::clone(&store.rows);
        tokio::spawn(async move {
            let mut mine = Vec::new();
            while let Some(job) = claim(&*rows).await {
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

pub(crate) async fn a_heartbeat_renews_the_lease_and_shows_the_progress(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    for completed in 1..=4 {
        store.clock.advance(LEASE - Duration::from_secs(1));
        assert_eq!(claim(rows).await, None, "the lease holds");
        let beat = rows.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(completed)).await.unwrap();
        assert_eq!(beat, Heartbeat::Alive);
    }
    let seen = job(rows, claimed.id).await;
    assert_eq!(seen.progress, progress(4));
    assert_eq!(seen.version, claimed.version + 4);
    rows.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(4)).await.unwrap();
    assert_eq!(job(rows, claimed.id).await.version, seen.version, "a beat without news is no change");
}

pub(crate) async fn a_worker_back_from_the_dead_cannot_publish(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let dead = claim(rows).await.unwrap();
    store.clock.advance(LEASE);
    let living = claim(rows).await.expect("the lease ran out");
    assert_eq!((living.id, living.attempt), (dead.id, 2));
    assert!(living.lease_token > dead.lease_token);
    assert_eq!(living.started_at, dead.started_at, "it started with its first claim");

    let beat = rows.heartbeat(dead.id, dead.lease_token, LEASE, &progress(9)).await.unwrap();
    assert_eq!(beat, Heartbeat::Lost);
    assert!(!rows.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert!(!rows.release(dead.id, dead.lease_token, Attempt::NotCounted).await.unwrap());
    assert_eq!(job(rows, dead.id).await, living, "nothing of the dead worker is to be seen");

    assert!(rows.finish(living.id, living.lease_token, &success()).await.unwrap());
    assert!(!rows.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert_eq!(job(rows, living.id).await.state, JobState::Succeeded);
}

pub(crate) async fn a_late_worker_whose_job_nobody_took_may_still_finish(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let slow = claim(rows).await.unwrap();
    store.clock.advance(LEASE * 3);
    assert!(rows.finish(slow.id, slow.lease_token, &success()).await.unwrap());
    assert_eq!(claim(rows).await, None);
}

pub(crate) async fn a_job_that_loses_its_worker_three_times_fails_and_does_not_stall_the_queue(store: Fresh) {
    let rows = &*store.rows;
    let poison = accept(rows, &stack()).await.id;
    let next = accept(rows, &stack()).await.id;
    for attempt in 1..=ATTEMPTS {
        let claimed = claim(rows).await.unwrap();
        assert_eq!((claimed.id, claimed.attempt), (poison, attempt));
        store.clock.advance(LEASE);
    }
    assert_eq!(claim(rows).await.unwrap().id, next);
    let ended = job(rows, poison).await;
    assert_eq!(ended.state, JobState::Failed);
    assert_eq!(ended.error.map(|fault| fault.code), Some(Code::WorkerLost));
    assert!(ended.finished_at.is_some());
}

pub(crate) async fn a_released_job_waits_again_and_the_attempt_does_not_count(store: Fresh) {
    let rows = &*store.rows;
    let id = accept(rows, &stack()).await.id;
    for _ in 0..=ATTEMPTS {
        let claimed = claim(rows).await.unwrap();
        assert_eq!((claimed.id, claimed.attempt), (id, 1));
        rows.heartbeat(id, claimed.lease_token, LEASE, &progress(3)).await.unwrap();
        assert!(rows.release(id, claimed.lease_token, Attempt::NotCounted).await.unwrap());
        let waiting = job(rows, id).await;
        assert_eq!((waiting.state, waiting.progress.fraction), (JobState::Queued, 0.0));
        assert!(!rows.finish(id, claimed.lease_token, &success()).await.unwrap(), "the lease went with the release");
    }
}

pub(crate) async fn a_cancel_reaches_the_worker_and_survives_its_death(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    assert_eq!(rows.cancel(claimed.id).await.unwrap(), Some(CancelRequest::Requested));
    assert!(job(rows, claimed.id).await.cancel_requested);
    let beat = rows.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(1)).await.unwrap();
    assert_eq!(beat, Heartbeat::CancelRequested);
    store.clock.advance(LEASE);
    assert_eq!(claim(rows).await, None, "a cancelled job is not tried again");
    assert_eq!(job(rows, claimed.id).await.state, JobState::Cancelled);
}

pub(crate) async fn a_job_whose_worker_is_gone_is_cancelled_without_one(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let dead = claim(rows).await.unwrap();
    store.clock.advance(LEASE);
    assert_eq!(rows.cancel(dead.id).await.unwrap(), Some(CancelRequest::Cancelled));
    assert!(!rows.finish(dead.id, dead.lease_token, &success()).await.unwrap());
    assert_eq!(job(rows, dead.id).await.state, JobState::Cancelled);
}

pub(crate) async fn a_released_job_that_was_to_end_ends(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    accept(rows, &stack()).await;
    let (cancelled, deleted) = (claim(rows).await.unwrap(), claim(rows).await.unwrap());
    rows.cancel(cancelled.id).await.unwrap();
    rows.delete_job(deleted.id).await.unwrap();
    assert!(rows.release(cancelled.id, cancelled.lease_token, Attempt::NotCounted).await.unwrap());
    assert!(rows.release(deleted.id, deleted.lease_token, Attempt::NotCounted).await.unwrap());
    assert_eq!(job(rows, cancelled.id).await.state, JobState::Cancelled);
    assert_eq!(rows.blob_owner(deleted.id).await.unwrap(), None);
    assert_eq!(claim(rows).await, None);
}

pub(crate) async fn a_deleted_job_whose_worker_died_goes_with_the_next_claim(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let dead = claim(rows).await.unwrap();
    assert!(rows.delete_job(dead.id).await.unwrap());
    store.clock.advance(LEASE);
    assert_eq!(claim(rows).await, None);
    assert_eq!(rows.blob_owner(dead.id).await.unwrap(), None);
}

pub(crate) async fn a_clock_that_leaps_forward_takes_no_job_from_a_living_worker(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    store.clock.advance(Duration::from_secs(1));
    store.clock.set_wall_by(10 * 365 * 24 * 60 * 60 * 1000);
    assert_eq!(claim(rows).await, None, "it was heard of a second ago");
    rows.heartbeat(claimed.id, claimed.lease_token, LEASE, &progress(1)).await.unwrap();
    store.clock.advance(LEASE - Duration::from_secs(1));
    assert_eq!(claim(rows).await, None, "the lease holds");
    assert!(rows.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
}

pub(crate) async fn a_clock_that_leaps_back_keeps_no_job_with_a_dead_worker(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let dead = claim(rows).await.unwrap();
    store.clock.set_wall_by(-10 * 365 * 24 * 60 * 60 * 1000);
    assert_eq!(claim(rows).await, None);
    store.clock.advance(LEASE);
    let living = claim(rows).await.expect("nothing was heard of its worker for a whole lease");
    assert_eq!((living.id, living.attempt), (dead.id, 2));
}

pub(crate) async fn a_lease_is_judged_by_its_own_length_and_not_by_that_of_who_looks(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let long = LEASE * 100;
    let claimed = rows.claim(long, ATTEMPTS).await.unwrap().unwrap();
    store.clock.advance(LEASE * 50);
    assert_eq!(claim(rows).await, None, "it is held for a hundred times as long");
    rows.heartbeat(claimed.id, claimed.lease_token, long, &progress(1)).await.unwrap();
    assert_eq!(claim(rows).await, None, "the heartbeat is seen");
    store.clock.advance(LEASE * 99);
    assert_eq!(claim(rows).await, None);
    store.clock.advance(LEASE);
    assert_eq!(claim(rows).await.map(|job| job.id), Some(claimed.id), "nothing was heard of it for all that time");
}

pub(crate) async fn a_job_released_with_a_pause_is_not_claimed_before_it_is_over(store: Fresh) {
    let rows = &*store.rows;
    let pause = Duration::from_secs(60);
    let (paused, next) = (accept(rows, &stack()).await.id, accept(rows, &stack()).await.id);
    let claimed = claim(rows).await.unwrap();
    assert!(rows.release(paused, claimed.lease_token, Attempt::Counted { pause }).await.unwrap());
    assert_eq!(job(rows, paused).await.attempt, 1, "it counts");
    let claimed = claim(rows).await.expect("the queue goes on");
    assert_eq!(claimed.id, next);
    assert!(rows.finish(next, claimed.lease_token, &success()).await.unwrap());
    store.clock.advance(pause - Duration::from_secs(1));
    assert_eq!(claim(rows).await, None);
    store.clock.advance(Duration::from_secs(1));
    let claimed = claim(rows).await.expect("the pause is over");
    assert_eq!((claimed.id, claimed.attempt), (paused, 2));
}
