//! Accepting, reading, cancelling and deleting jobs.

use super::*;
use crate::{
    contract::{Code, Fault, JobKind, JobState, profile::Profile},
    store::{BlobOwner, CancelRequest, Finish, JobCounts, JobFilter, Retention},
};
use pinstack_science::types::{Warning, WarningCode};

pub async fn an_accepted_job_is_queued_with_its_whole_request(store: Fresh) {
    let metadata = &*store.metadata;
    super::scans::with_scan(metadata, "beetle").await;
    let mut asked = stack_with(|request| {
        request.options.scan = Some(name("beetle"));
        request.options.mask_threshold = pinstack_science::types::mask_options::MaskThreshold::Fixed(0.25);
    });
    asked.trace = Some("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01 a=1".into());
    asked.warnings.push(Warning::new(WarningCode::Other("junk".into()), "a file was passed over"));
    let accepted = accept(metadata, &asked).await;
    assert_eq!(accepted.request, asked.request);
    assert_eq!((accepted.state, accepted.attempt), (JobState::Queued, 0));
    assert_eq!(accepted.warnings, asked.warnings);
    assert_eq!(accepted.progress.stage, "waiting");
    assert_eq!(accepted.trace, asked.trace);
    assert_eq!(job(metadata, asked.id).await, accepted);
    assert_eq!(metadata.job(Uuid::now_v7()).await.unwrap(), None);
}

pub async fn a_repeated_key_gives_the_first_job_and_another_request_is_refused(store: Fresh) {
    let metadata = &*store.metadata;
    let with_key = |fingerprint: &str| NewJob { idempotency: Some(("k".into(), fingerprint.into())), ..stack() };
    let first = accept(metadata, &with_key("same")).await;
    assert_eq!(metadata.enqueue(&with_key("same"), 1).await.unwrap(), Enqueue::Repeated(Box::new(first.clone())));
    assert_eq!(metadata.enqueue(&with_key("other"), 1).await.unwrap(), Enqueue::KeyReused);
    assert_eq!(metadata.by_idempotency_key("k").await.unwrap(), Some((first.clone(), "same".into())));
    assert_eq!(metadata.by_idempotency_key("j").await.unwrap(), None);
    assert_eq!(metadata.counts().await.unwrap().queued, 1);
    // a deleted job frees its key
    assert!(metadata.delete_job(first.id).await.unwrap());
    assert!(matches!(metadata.enqueue(&with_key("other"), 1).await.unwrap(), Enqueue::Accepted(_)));
}

pub async fn concurrent_repeats_of_one_key_make_one_job(store: Fresh) {
    let posts = (0..10).map(|_| {
        let metadata = Arc::clone(&store.metadata);
        let job = NewJob { idempotency: Some(("k".into(), "f".into())), ..stack() };
        async move { metadata.enqueue(&job, 100).await.unwrap() }
    });
    let answers = futures::future::join_all(posts).await;
    let accepted = answers.iter().filter(|a| matches!(a, Enqueue::Accepted(_))).count();
    let repeated = answers.iter().filter(|a| matches!(a, Enqueue::Repeated(_))).count();
    assert_eq!((accepted, repeated), (1, 9));
}

pub async fn a_full_queue_refuses_until_a_worker_takes_one(store: Fresh) {
    let metadata = &*store.metadata;
    for _ in 0..2 {
        assert!(matches!(metadata.enqueue(&stack(), 2).await.unwrap(), Enqueue::Accepted(_)));
    }
    assert_eq!(metadata.enqueue(&stack(), 2).await.unwrap(), Enqueue::QueueFull { waiting: 2 });
    claim(metadata).await.expect("one waits");
    assert!(matches!(metadata.enqueue(&stack(), 2).await.unwrap(), Enqueue::Accepted(_)));
}

pub async fn the_queue_is_told_in_the_order_of_acceptance(store: Fresh) {
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for _ in 0..4 {
        let job = stack();
        ids.push(job.id);
        assert!(matches!(metadata.enqueue(&job, 10).await.unwrap(), Enqueue::Accepted(_)));
    }
    assert_eq!(metadata.queued(10).await.unwrap(), ids);
    assert_eq!(metadata.queued(2).await.unwrap(), ids[..2]);
    claim(metadata).await.expect("one waits");
    metadata.cancel(ids[2]).await.unwrap();
    assert_eq!(metadata.queued(10).await.unwrap(), [ids[1], ids[3]], "neither running nor cancelled ones wait");
}

pub async fn lists_are_paged_newest_first_and_filtered(store: Fresh) {
    let metadata = &*store.metadata;
    super::scans::with_scan(metadata, "s").await;
    let mut ids = Vec::new();
    for i in 0..5 {
        let job = if i == 2 { calibration() } else { stack_with(|r| r.options.scan = (i > 2).then(|| name("s"))) };
        ids.push(accept(metadata, &job).await.id);
    }
    claim(metadata).await.expect("the calibration comes first");
    let found = async |filter: JobFilter| -> Vec<Uuid> {
        let mut found = Vec::new();
        let mut cursor = None;
        loop {
            let part = metadata.jobs(&filter, &page(2, cursor)).await.unwrap();
            found.extend(part.items.iter().map(|job| job.id));
            cursor = part.next_cursor;
            if cursor.is_none() {
                return found;
            }
        }
    };
    let all = JobFilter::default();
    assert_eq!(found(all.clone()).await, ids.iter().rev().copied().collect::<Vec<_>>());
    assert_eq!(found(JobFilter { kind: Some(JobKind::Calibration), ..all.clone() }).await, [ids[2]]);
    assert_eq!(found(JobFilter { state: Some(JobState::Running), ..all.clone() }).await, [ids[2]]);
    assert_eq!(found(JobFilter { scan: Some(name("s")), ..all.clone() }).await, [ids[4], ids[3]]);
    assert!(found(JobFilter { rig: Some(name("other")), ..all.clone() }).await.is_empty());
    assert!(found(JobFilter { lens: Some(name("other")), ..all }).await.is_empty());
    assert_eq!(metadata.counts().await.unwrap(), JobCounts { queued: 4, running: 1, ..JobCounts::default() });
}

pub async fn a_success_shows_its_outcome(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    store.clock.advance(Duration::from_secs(3));
    let warnings = vec![Warning::new(WarningCode::Other("thin".into()), "the hair is thin")];
    let finish = Finish::Succeeded { outcome: Box::new(stack_outcome()), warnings: warnings.clone(), profile: None };
    assert!(metadata.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(metadata, claimed.id).await;
    assert_eq!((ended.state, ended.progress.fraction), (JobState::Succeeded, 1.0));
    assert_eq!(ended.outcome, Some(stack_outcome()));
    assert_eq!(ended.warnings, warnings);
    let took = ended.finished_at.unwrap().as_millisecond() - ended.started_at.unwrap().as_millisecond();
    assert_eq!(took, 3000);
    assert!(!metadata.finish(claimed.id, claimed.lease_token, &success()).await.unwrap(), "an end is final");
}

pub async fn a_calibration_stores_its_revision_with_its_end(store: Fresh) {
    let metadata = &*store.metadata;
    put(metadata, "rig", "lens", 1.25).await;
    accept(metadata, &calibration()).await;
    let claimed = claim(metadata).await.unwrap();
    let measured = ProfileDraft { calibration_id: Some(claimed.id), ..draft(1.5) };
    let (outcome, profile) = (Box::new(calibration_outcome()), Some(Box::new(measured.clone())));
    let finish = Finish::Succeeded { outcome, warnings: vec![], profile };
    assert!(metadata.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let stored: Profile = metadata.profile(&name("rig"), &name("lens"), None).await.unwrap().unwrap();
    assert_eq!((stored.revision, stored.calibration_id), (2, Some(claimed.id)));
    assert_eq!(stored.input, measured.input);
    let Some(JobOutcome::Calibration(outcome)) = job(metadata, claimed.id).await.outcome else { panic!("no outcome") };
    assert_eq!((outcome.profile_revision, outcome.profile_digest), (Some(2), Some(stored.digest)));
}

pub async fn a_failure_shows_its_fault(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    let fault = Fault::new(Code::InvalidImage, "front/2.png is torn").in_file("front/2.png", Some(1));
    assert!(metadata.finish(claimed.id, claimed.lease_token, &Finish::Failed(fault.clone())).await.unwrap());
    let ended = job(metadata, claimed.id).await;
    assert_eq!((ended.state, ended.error, ended.outcome), (JobState::Failed, Some(fault), None));
}

pub async fn a_queued_job_is_cancelled_at_once_and_never_claimed(store: Fresh) {
    let metadata = &*store.metadata;
    let waiting = accept(metadata, &stack()).await;
    assert_eq!(metadata.cancel(waiting.id).await.unwrap(), Some(CancelRequest::Cancelled));
    let ended = job(metadata, waiting.id).await;
    assert_eq!(ended.state, JobState::Cancelled);
    assert!(ended.finished_at.is_some() && ended.version > waiting.version);
    assert_eq!(claim(metadata).await, None);
    let again = metadata.cancel(waiting.id).await.unwrap();
    assert_eq!(again, Some(CancelRequest::AlreadyEnded(JobState::Cancelled)));
    assert_eq!(metadata.cancel(Uuid::now_v7()).await.unwrap(), None);
}

pub async fn a_cancel_before_the_end_wins_over_success(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &calibration()).await;
    let claimed = claim(metadata).await.unwrap();
    assert_eq!(metadata.cancel(claimed.id).await.unwrap(), Some(CancelRequest::Requested));
    let (outcome, profile) = (Box::new(calibration_outcome()), Some(Box::new(draft(1.5))));
    let finish = Finish::Succeeded { outcome, warnings: vec![], profile };
    assert!(metadata.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(metadata, claimed.id).await;
    assert_eq!((ended.state, ended.outcome), (JobState::Cancelled, None));
    assert_eq!(
        metadata.profile(&name("rig"), &name("lens"), None).await.unwrap(),
        None,
        "no revision of a cancelled one"
    );
}

pub async fn a_cancel_after_the_end_changes_nothing(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack()).await;
    let claimed = claim(metadata).await.unwrap();
    assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    let before = job(metadata, claimed.id).await;
    let late = metadata.cancel(claimed.id).await.unwrap();
    assert_eq!(late, Some(CancelRequest::AlreadyEnded(JobState::Succeeded)));
    assert_eq!(job(metadata, claimed.id).await, before);
}

pub async fn a_concurrent_cancel_and_finish_have_one_winner(store: Fresh) {
    for _ in 0..20 {
        let metadata = &*store.metadata;
        accept(metadata, &stack()).await;
        let claimed = claim(metadata).await.unwrap();
        let finished = success();
        let (cancel, finish) =
            tokio::join!(metadata.cancel(claimed.id), metadata.finish(claimed.id, claimed.lease_token, &finished));
        assert!(finish.unwrap());
        let ended = job(metadata, claimed.id).await;
        match cancel.unwrap().expect("it exists") {
            CancelRequest::Requested => assert_eq!(ended.state, JobState::Cancelled),
            CancelRequest::AlreadyEnded(state) => {
                assert_eq!((state, ended.state), (JobState::Succeeded, JobState::Succeeded));
            }
            CancelRequest::Cancelled => panic!("a running job cannot be cancelled behind its worker's back"),
        }
    }
}

pub async fn a_deleted_job_disappears_and_a_running_one_when_its_worker_releases_it(store: Fresh) {
    let metadata = &*store.metadata;
    let waiting = accept(metadata, &stack()).await.id;
    assert!(metadata.delete_job(waiting).await.unwrap());
    assert!(!metadata.delete_job(waiting).await.unwrap());
    assert_eq!(metadata.blob_owner(waiting).await.unwrap(), None);

    accept(metadata, &stack()).await;
    let running = claim(metadata).await.unwrap();
    assert!(metadata.delete_job(running.id).await.unwrap());
    assert_eq!(metadata.job(running.id).await.unwrap(), None);
    assert!(metadata.jobs(&JobFilter::default(), &page(10, None)).await.unwrap().items.is_empty());
    assert!(!metadata.delete_job(running.id).await.unwrap());
    assert_eq!(metadata.cancel(running.id).await.unwrap(), None);
    assert_eq!(
        metadata.blob_owner(running.id).await.unwrap(),
        Some(BlobOwner { state: JobState::Running, lease_token: running.lease_token, upload_removed: false })
    );
    assert!(metadata.finish(running.id, running.lease_token, &success()).await.unwrap());
    assert_eq!(metadata.blob_owner(running.id).await.unwrap(), None);
    assert_eq!(metadata.counts().await.unwrap(), JobCounts::default());
}

pub async fn a_job_expires_after_its_retention_time(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &stack_with(|request| request.options.keep_days = Some(2))).await;
    let kept = accept(metadata, &stack()).await.id;
    let claimed = claim(metadata).await.unwrap();
    let day = Duration::from_secs(24 * 60 * 60);
    store.clock.advance(day * 5);
    assert!(
        metadata.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty(),
        "days count from the end, and it runs"
    );
    assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    store.clock.advance(day * 2 - Duration::from_secs(1));
    assert!(metadata.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    store.clock.advance(Duration::from_secs(1));
    assert_eq!(metadata.delete_expired_jobs(&Retention::default()).await.unwrap(), [claimed.id]);
    assert_eq!(metadata.job(claimed.id).await.unwrap(), None);
    assert!(metadata.job(kept).await.unwrap().is_some());
}

pub async fn every_visible_change_is_announced_and_counted(store: Fresh) {
    let metadata = &*store.metadata;
    let mut changes = metadata.changes();
    let accepted = accept(metadata, &stack()).await;
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    let claimed = claim(metadata).await.unwrap();
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    assert!(claimed.version > accepted.version);
    metadata.cancel(accepted.id).await.unwrap();
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    assert!(job(metadata, accepted.id).await.version > claimed.version);
    assert!(metadata.healthy().await);
}

pub async fn the_versions_of_several_jobs_are_read_at_once(store: Fresh) {
    let metadata = &*store.metadata;
    let [first, second, deleted] =
        [accept(metadata, &stack()).await, accept(metadata, &stack()).await, accept(metadata, &stack()).await];
    metadata.cancel(second.id).await.unwrap();
    assert!(metadata.delete_job(deleted.id).await.unwrap());
    let mut found = metadata.versions(&[first.id, second.id, deleted.id, Uuid::now_v7()]).await.unwrap();
    found.sort_unstable();
    assert_eq!(found, [(first.id, first.version), (second.id, second.version + 1)]);
    assert_eq!(metadata.versions(&[]).await.unwrap(), []);
}

pub async fn a_page_ends_at_its_size_limit(store: Fresh) {
    let metadata = &*store.metadata;
    let mut ids = Vec::new();
    for _ in 0..5 {
        // a megabyte of names each
        let job = stack_with(|request| request.layout.front = vec!["x".repeat(1000); 1000]);
        ids.push(accept(metadata, &job).await.id);
    }
    ids.reverse();
    let (mut seen, mut sizes, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let part = metadata.jobs(&JobFilter::default(), &page(500, cursor)).await.unwrap();
        sizes.push(part.items.len());
        seen.extend(part.items.iter().map(|job| job.id));
        cursor = part.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    assert_eq!((seen, sizes), (ids, vec![3, 2]));
}

pub async fn a_result_that_could_not_be_read_again_fails_the_job(store: Fresh) {
    let metadata = &*store.metadata;
    accept(metadata, &calibration()).await;
    let claimed = claim(metadata).await.unwrap();
    let mut measured = draft(1.5);
    measured.slices[0].scale = f64::NAN;
    let finish = Finish::Succeeded {
        outcome: Box::new(calibration_outcome()),
        warnings: vec![],
        profile: Some(Box::new(measured)),
    };
    assert!(metadata.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(metadata, claimed.id).await;
    assert_eq!((ended.state, ended.error.map(|fault| fault.code)), (JobState::Failed, Some(Code::Internal)));
    assert!(metadata.profiles(None, None, &page(10, None)).await.unwrap().items.is_empty());
}
