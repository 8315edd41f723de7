//! The order of the queue: priorities, and rigs that take turns.

use super::*;
use crate::{
    contract::{Priority, Progress},
    store::{Attempt, uploads::NewUpload},
};

/// Bytes of a zip that counts as one unit in these tests.
const UNIT: u64 = 1 << 20;

/// Accepts a stack of a rig; returns its id.
async fn send(metadata: &dyn MetadataStore, rig: &str, units: u64, priority: Priority) -> Uuid {
    let job = stack_with(|request| {
        request.upload.bytes = units * UNIT;
        request.options.priority = priority;
    });
    accept(metadata, &NewJob { rig: name(rig), ..job }).await.id
}

async fn normal(metadata: &dyn MetadataStore, rig: &str) -> Uuid {
    send(metadata, rig, 1, Priority::Normal).await
}

/// Claims and ends the next job; returns its id.
async fn run_next(metadata: &dyn MetadataStore) -> Uuid {
    let job = claim(metadata).await.expect("a job waits");
    assert!(metadata.finish(job.id, job.lease_token, &success()).await.expect("finish"));
    job.id
}

/// The order in which all jobs are claimed, which must be the order in which the queue lists them.
async fn run_all(metadata: &dyn MetadataStore) -> Vec<Uuid> {
    let told = metadata.queued(1000).await.expect("the queue");
    let mut claimed = Vec::new();
    for _ in &told {
        claimed.push(run_next(metadata).await);
    }
    assert_eq!(claimed, told);
    claimed
}

pub async fn rigs_take_turns(store: Fresh) {
    let metadata = &*store.metadata;
    let mut scan = Vec::new();
    for _ in 0..4 {
        scan.push(normal(metadata, "macro").await);
    }
    let others = [normal(metadata, "micro").await, normal(metadata, "micro").await];
    assert_eq!(run_all(metadata).await, [scan[0], others[0], scan[1], others[1], scan[2], scan[3]]);
}

pub async fn a_rig_that_sends_late_is_next_and_does_not_catch_up_on_the_past(store: Fresh) {
    let metadata = &*store.metadata;
    let mut scan = Vec::new();
    for _ in 0..6 {
        scan.push(normal(metadata, "macro").await);
    }
    for id in &scan[..3] {
        assert_eq!(run_next(metadata).await, *id);
    }
    let late = [normal(metadata, "micro").await, normal(metadata, "micro").await, normal(metadata, "micro").await];
    assert_eq!(run_all(metadata).await, [late[0], scan[3], late[1], scan[4], late[2], scan[5]]);
}

pub async fn a_rig_that_sends_one_stack_after_another_does_not_push_others_aside(store: Fresh) {
    let metadata = &*store.metadata;
    let mut scan = Vec::new();
    for _ in 0..4 {
        scan.push(normal(metadata, "macro").await);
    }
    let mut ran = Vec::new();
    // each of its stacks is sent when the one before has ended
    for _ in 0..4 {
        let one = normal(metadata, "micro").await;
        while ran.last() != Some(&one) {
            ran.push(run_next(metadata).await);
        }
    }
    let of_scan = ran.iter().filter(|id| scan.contains(id)).count();
    assert!(of_scan >= 3, "{of_scan} of the 4 stacks of the other rig ran beside 4 of this one");
}

pub async fn a_turn_is_measured_by_the_size_of_the_zips(store: Fresh) {
    let metadata = &*store.metadata;
    let large =
        [send(metadata, "macro", 4, Priority::Normal).await, send(metadata, "macro", 4, Priority::Normal).await];
    let mut small = Vec::new();
    for _ in 0..5 {
        small.push(normal(metadata, "micro").await);
    }
    let expected = [large[0], small[0], small[1], small[2], small[3], large[1], small[4]];
    assert_eq!(run_all(metadata).await, expected);
}

pub async fn a_high_priority_passes_the_jobs_of_its_rig_and_a_low_one_waits_for_all(store: Fresh) {
    let metadata = &*store.metadata;
    let low = send(metadata, "rig", 1, Priority::Low).await;
    let first = normal(metadata, "rig").await;
    let second = normal(metadata, "rig").await;
    let high = send(metadata, "rig", 1, Priority::High).await;
    let other = normal(metadata, "other").await;
    assert_eq!(run_all(metadata).await, [high, first, other, second, low]);
}

pub async fn a_calibration_passes_the_stacks_of_its_rig(store: Fresh) {
    let metadata = &*store.metadata;
    let mut scan = Vec::new();
    for _ in 0..3 {
        scan.push(normal(metadata, "rig").await);
    }
    assert_eq!(run_next(metadata).await, scan[0]);
    let target = accept(metadata, &calibration()).await.id;
    assert_eq!(run_all(metadata).await, [target, scan[1], scan[2]]);
}

pub async fn a_rig_whose_jobs_are_all_urgent_does_not_push_others_aside(store: Fresh) {
    let metadata = &*store.metadata;
    let mut urgent = Vec::new();
    for _ in 0..8 {
        urgent.push(send(metadata, "macro", 1, Priority::High).await);
    }
    let mut others = Vec::new();
    for _ in 0..4 {
        others.push(normal(metadata, "micro").await);
    }
    let ran = run_all(metadata).await;
    let first_half = &ran[..8];
    let of_others = first_half.iter().filter(|id| others.contains(id)).count();
    assert!(of_others >= 3, "{of_others} of the first 8 jobs were of the other rig, which had sent 4");
    assert_eq!(first_half[0], urgent[0]);
}

pub async fn cancelled_stacks_cost_their_rig_no_turn(store: Fresh) {
    let metadata = &*store.metadata;
    let mut scan = Vec::new();
    for _ in 0..5 {
        scan.push(normal(metadata, "macro").await);
    }
    for id in &scan[1..] {
        metadata.cancel(*id).await.expect("cancel");
    }
    let others = [normal(metadata, "micro").await, normal(metadata, "micro").await];
    let again = normal(metadata, "macro").await;
    assert_eq!(run_all(metadata).await, [scan[0], others[0], others[1], again]);
}

pub async fn tokens_of_one_rig_take_turns(store: Fresh) {
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for owner in [1, 1, 1, 2] {
        let job = NewJob { owner: Some(Uuid::from_u128(owner)), ..stack_with(|request| request.upload.bytes = UNIT) };
        ids.push(accept(metadata, &job).await.id);
    }
    assert_eq!(run_all(metadata).await, [ids[0], ids[3], ids[1], ids[2]]);
}

pub async fn a_resumable_upload_takes_the_turn_of_its_token(store: Fresh) {
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for owner in [1, 1, 2] {
        let id = Uuid::now_v7();
        let owner = Some(Uuid::from_u128(owner));
        let keep = Duration::from_secs(3600);
        let upload = NewUpload { id, length: UNIT, digest: vec![], metadata: String::new(), keep, owner };
        metadata.create_upload(&upload, uploads::MANY).await.expect("an upload");
        assert!(metadata.advance_upload(id, &uploads::advance(0, UNIT)).await.expect("its bytes"));
        let job = NewJob { id, ..stack_with(|request| request.upload.bytes = UNIT) };
        let completed = metadata.complete_upload(&job, 10).await.expect("complete");
        assert!(matches!(completed, Some(Enqueue::Accepted(_))), "{completed:?}");
        ids.push(id);
    }
    assert_eq!(run_all(metadata).await, [ids[0], ids[2], ids[1]]);
}

pub async fn workers_hear_of_jobs_that_join_the_queue_and_of_nothing_else(store: Fresh) {
    let metadata = &*store.metadata;
    let mut arrivals = metadata.arrivals();
    normal(metadata, "rig").await;
    arrivals.recv().await.expect("a job was accepted");
    let job = claim(metadata).await.expect("a job waits");
    let progress = Progress { stage: "fusing".into(), completed: 1, total: 2, fraction: 0.5 };
    metadata.heartbeat(job.id, job.lease_token, LEASE, &progress).await.expect("heartbeat");
    assert!(arrivals.try_recv().is_err(), "a job that runs leaves no work for others");
    assert!(metadata.release(job.id, job.lease_token, Attempt::NotCounted).await.expect("release"));
    arrivals.recv().await.expect("a job returned to the queue");
}

pub async fn a_job_that_returns_to_the_queue_keeps_its_turn(store: Fresh) {
    let metadata = &*store.metadata;
    let first = normal(metadata, "macro").await;
    let second = normal(metadata, "macro").await;
    let claimed = claim(metadata).await.expect("a job waits");
    assert_eq!(claimed.id, first);
    assert!(metadata.release(claimed.id, claimed.lease_token, Attempt::NotCounted).await.expect("release"));
    let other = normal(metadata, "micro").await;
    assert_eq!(run_all(metadata).await, [first, other, second]);
}
