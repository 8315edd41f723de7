//! Accepting, reading, cancelling and deleting jobs.

use super::*;
use crate::{
    contract::{Code, Fault, JobKind, JobState, profile::Profile},
    store::{BlobOwner, CancelRequest, Finish, JobCounts, JobFilter, Retention},
};
use pinstack_science::types::Warning;

pub(crate) async fn an_accepted_job_waits_with_all_that_was_asked(store: Fresh) {
    let rows = &*store.rows;
    let mut asked = stack_with(|request| {
        request.options.scan = Some(name("beetle"));
        request.options.mask_threshold = pinstack_science::types::mask_options::MaskThreshold::Fixed(0.25);
    });
    asked.warnings.push(Warning::new("junk", "a file was passed over"));
    let accepted = accept(rows, &asked).await;
    assert_eq!(accepted.request, asked.request);
    assert_eq!((accepted.state, accepted.attempt), (JobState::Queued, 0));
    assert_eq!(accepted.warnings, asked.warnings);
    assert_eq!(accepted.progress.stage, "waiting");
    assert_eq!(job(rows, asked.id).await, accepted);
    assert_eq!(rows.job(Uuid::now_v7()).await.unwrap(), None);
}

pub(crate) async fn a_repeated_key_gives_the_first_job_and_another_request_is_refused(store: Fresh) {
    let rows = &*store.rows;
    let with_key = |fingerprint: &str| NewJob { idempotency: Some(("k".into(), fingerprint.into())), ..stack() };
    let first = accept(rows, &with_key("same")).await;
    assert_eq!(rows.enqueue(&with_key("same"), 1).await.unwrap(), Enqueue::Repeated(Box::new(first.clone())));
    assert_eq!(rows.enqueue(&with_key("other"), 1).await.unwrap(), Enqueue::KeyReused);
    assert_eq!(rows.by_idempotency_key("k").await.unwrap(), Some((first.clone(), "same".into())));
    assert_eq!(rows.by_idempotency_key("j").await.unwrap(), None);
    assert_eq!(rows.counts().await.unwrap().queued, 1);
    // a deleted job frees its key
    assert!(rows.delete_job(first.id).await.unwrap());
    assert!(matches!(rows.enqueue(&with_key("other"), 1).await.unwrap(), Enqueue::Accepted(_)));
}

pub(crate) async fn concurrent_repeats_of_one_key_make_one_job(store: Fresh) {
    let posts = (0..10).map(|_| {
        let rows = Arc::clone(&store.rows);
        let job = NewJob { idempotency: Some(("k".into(), "f".into())), ..stack() };
        async move { rows.enqueue(&job, 100).await.unwrap() }
    });
    let answers = futures::future::join_all(posts).await;
    let accepted = answers.iter().filter(|a| matches!(a, Enqueue::Accepted(_))).count();
    let repeated = answers.iter().filter(|a| matches!(a, Enqueue::Repeated(_))).count();
    assert_eq!((accepted, repeated), (1, 9));
}

pub(crate) async fn a_full_queue_refuses_until_a_worker_takes_one(store: Fresh) {
    let rows = &*store.rows;
    for _ in 0..2 {
        assert!(matches!(rows.enqueue(&stack(), 2).await.unwrap(), Enqueue::Accepted(_)));
    }
    assert_eq!(rows.enqueue(&stack(), 2).await.unwrap(), Enqueue::QueueFull { waiting: 2 });
    claim(rows).await.expect("one waits");
    assert!(matches!(rows.enqueue(&stack(), 2).await.unwrap(), Enqueue::Accepted(_)));
}

pub(crate) async fn lists_are_paged_newest_first_and_filtered(store: Fresh) {
    let rows = &*store.rows;
    let mut ids = Vec::new();
    for i in 0..5 {
        let job = if i == 2 { calibration() } else { stack_with(|r| r.options.scan = (i > 2).then(|| name("s"))) };
        ids.push(accept(rows, &job).await.id);
    }
    claim(rows).await.expect("the oldest");
    let found = async |filter: JobFilter| -> Vec<Uuid> {
        let mut found = Vec::new();
        let mut cursor = None;
        loop {
            let part = rows.jobs(&filter, &page(2, cursor)).await.unwrap();
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
    assert_eq!(found(JobFilter { state: Some(JobState::Running), ..all.clone() }).await, [ids[0]]);
    assert_eq!(found(JobFilter { scan: Some(name("s")), ..all.clone() }).await, [ids[4], ids[3]]);
    assert!(found(JobFilter { rig: Some(name("other")), ..all.clone() }).await.is_empty());
    assert!(found(JobFilter { lens: Some(name("other")), ..all }).await.is_empty());
    assert_eq!(rows.counts().await.unwrap(), JobCounts { queued: 4, running: 1, ..JobCounts::default() });
}

pub(crate) async fn a_success_shows_its_outcome(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    store.clock.advance(Duration::from_secs(3));
    let warnings = vec![Warning::new("thin", "the hair is thin")];
    let finish = Finish::Succeeded { outcome: Box::new(stack_outcome()), warnings: warnings.clone(), profile: None };
    assert!(rows.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(rows, claimed.id).await;
    assert_eq!((ended.state, ended.progress.fraction), (JobState::Succeeded, 1.0));
    assert_eq!(ended.outcome, Some(stack_outcome()));
    assert_eq!(ended.warnings, warnings);
    let took = ended.finished_at.unwrap().as_millisecond() - ended.started_at.unwrap().as_millisecond();
    assert_eq!(took, 3000);
    assert!(!rows.finish(claimed.id, claimed.lease_token, &success()).await.unwrap(), "an end is final");
}

pub(crate) async fn a_calibration_stores_its_revision_with_its_end(store: Fresh) {
    let rows = &*store.rows;
    put(rows, "rig", "lens", 1.25).await;
    accept(rows, &calibration()).await;
    let claimed = claim(rows).await.unwrap();
    let measured = ProfileDraft { calibration_id: Some(claimed.id), ..draft(1.5) };
    let (outcome, profile) = (Box::new(calibration_outcome()), Some(Box::new(measured.clone())));
    let finish = Finish::Succeeded { outcome, warnings: vec![], profile };
    assert!(rows.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let stored: Profile = rows.profile(&name("rig"), &name("lens"), None).await.unwrap().unwrap();
    assert_eq!((stored.revision, stored.calibration_id), (2, Some(claimed.id)));
    assert_eq!(stored.input, measured.input);
    let Some(JobOutcome::Calibration(outcome)) = job(rows, claimed.id).await.outcome else { panic!("no outcome") };
    assert_eq!((outcome.profile_revision, outcome.profile_digest), (2, stored.digest));
}

pub(crate) async fn a_failure_shows_its_fault(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    let fault = Fault::new(Code::InvalidImage, "front/2.png is torn").in_file("front/2.png", Some(1));
    assert!(rows.finish(claimed.id, claimed.lease_token, &Finish::Failed(fault.clone())).await.unwrap());
    let ended = job(rows, claimed.id).await;
    assert_eq!((ended.state, ended.error, ended.outcome), (JobState::Failed, Some(fault), None));
}

pub(crate) async fn a_waiting_job_is_cancelled_at_once_and_never_claimed(store: Fresh) {
    let rows = &*store.rows;
    let waiting = accept(rows, &stack()).await;
    assert_eq!(rows.cancel(waiting.id).await.unwrap(), Some(CancelRequest::Cancelled));
    let ended = job(rows, waiting.id).await;
    assert_eq!(ended.state, JobState::Cancelled);
    assert!(ended.finished_at.is_some() && ended.version > waiting.version);
    assert_eq!(claim(rows).await, None);
    let again = rows.cancel(waiting.id).await.unwrap();
    assert_eq!(again, Some(CancelRequest::AlreadyEnded(JobState::Cancelled)));
    assert_eq!(rows.cancel(Uuid::now_v7()).await.unwrap(), None);
}

pub(crate) async fn a_cancel_before_the_end_wins_over_success(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &calibration()).await;
    let claimed = claim(rows).await.unwrap();
    assert_eq!(rows.cancel(claimed.id).await.unwrap(), Some(CancelRequest::Requested));
    let (outcome, profile) = (Box::new(calibration_outcome()), Some(Box::new(draft(1.5))));
    let finish = Finish::Succeeded { outcome, warnings: vec![], profile };
    assert!(rows.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(rows, claimed.id).await;
    assert_eq!((ended.state, ended.outcome), (JobState::Cancelled, None));
    assert_eq!(rows.profile(&name("rig"), &name("lens"), None).await.unwrap(), None, "no revision of a cancelled one");
}

pub(crate) async fn a_cancel_after_the_end_changes_nothing(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack()).await;
    let claimed = claim(rows).await.unwrap();
    assert!(rows.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    let before = job(rows, claimed.id).await;
    let late = rows.cancel(claimed.id).await.unwrap();
    assert_eq!(late, Some(CancelRequest::AlreadyEnded(JobState::Succeeded)));
    assert_eq!(job(rows, claimed.id).await, before);
}

pub(crate) async fn a_cancel_that_meets_a_finish_has_one_winner(store: Fresh) {
    for _ in 0..20 {
        let rows = &*store.rows;
        accept(rows, &stack()).await;
        let claimed = claim(rows).await.unwrap();
        let finished = success();
        let (cancel, finish) =
            tokio::join!(rows.cancel(claimed.id), rows.finish(claimed.id, claimed.lease_token, &finished));
        assert!(finish.unwrap());
        let ended = job(rows, claimed.id).await;
        match cancel.unwrap().expect("it exists") {
            CancelRequest::Requested => assert_eq!(ended.state, JobState::Cancelled),
            CancelRequest::AlreadyEnded(state) => {
                assert_eq!((state, ended.state), (JobState::Succeeded, JobState::Succeeded));
            }
            CancelRequest::Cancelled => panic!("a running job cannot be cancelled behind its worker's back"),
        }
    }
}

pub(crate) async fn a_deleted_job_is_gone_and_a_running_one_goes_with_its_worker(store: Fresh) {
    let rows = &*store.rows;
    let waiting = accept(rows, &stack()).await.id;
    assert!(rows.delete_job(waiting).await.unwrap());
    assert!(!rows.delete_job(waiting).await.unwrap());
    assert_eq!(rows.blob_owner(waiting).await.unwrap(), None);

    accept(rows, &stack()).await;
    let running = claim(rows).await.unwrap();
    assert!(rows.delete_job(running.id).await.unwrap());
    assert_eq!(rows.job(running.id).await.unwrap(), None);
    assert!(rows.jobs(&JobFilter::default(), &page(10, None)).await.unwrap().items.is_empty());
    assert!(!rows.delete_job(running.id).await.unwrap());
    assert_eq!(rows.cancel(running.id).await.unwrap(), None);
    assert_eq!(
        rows.blob_owner(running.id).await.unwrap(),
        Some(BlobOwner { state: JobState::Running, lease_token: running.lease_token, upload_removed: false })
    );
    assert!(rows.finish(running.id, running.lease_token, &success()).await.unwrap());
    assert_eq!(rows.blob_owner(running.id).await.unwrap(), None);
    assert_eq!(rows.counts().await.unwrap(), JobCounts::default());
}

pub(crate) async fn a_job_expires_only_after_its_days(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &stack_with(|request| request.options.keep_days = Some(2))).await;
    let kept = accept(rows, &stack()).await.id;
    let claimed = claim(rows).await.unwrap();
    let day = Duration::from_secs(24 * 60 * 60);
    store.clock.advance(day * 5);
    assert!(
        rows.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty(),
        "days count from the end, and it runs"
    );
    assert!(rows.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    store.clock.advance(day * 2 - Duration::from_secs(1));
    assert!(rows.delete_expired_jobs(&Retention::default()).await.unwrap().is_empty());
    store.clock.advance(Duration::from_secs(1));
    assert_eq!(rows.delete_expired_jobs(&Retention::default()).await.unwrap(), [claimed.id]);
    assert_eq!(rows.job(claimed.id).await.unwrap(), None);
    assert!(rows.job(kept).await.unwrap().is_some());
}

pub(crate) async fn every_visible_change_is_announced_and_counted(store: Fresh) {
    let rows = &*store.rows;
    let mut changes = rows.changes();
    let accepted = accept(rows, &stack()).await;
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    let claimed = claim(rows).await.unwrap();
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    assert!(claimed.version > accepted.version);
    rows.cancel(accepted.id).await.unwrap();
    assert_eq!(changes.recv().await.unwrap(), accepted.id);
    assert!(job(rows, accepted.id).await.version > claimed.version);
    assert!(rows.healthy().await);
}

pub(crate) async fn a_page_ends_before_it_is_too_large(store: Fresh) {
    let rows = &*store.rows;
    let mut ids = Vec::new();
    for _ in 0..5 {
        // a megabyte of names each
        let job = stack_with(|request| request.layout.front = vec!["x".repeat(1000); 1000]);
        ids.push(accept(rows, &job).await.id);
    }
    ids.reverse();
    let (mut seen, mut sizes, mut cursor) = (Vec::new(), Vec::new(), None);
    loop {
        let part = rows.jobs(&JobFilter::default(), &page(500, cursor)).await.unwrap();
        sizes.push(part.items.len());
        seen.extend(part.items.iter().map(|job| job.id));
        cursor = part.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    assert_eq!((seen, sizes), (ids, vec![3, 2]));
}

pub(crate) async fn a_result_that_could_not_be_read_again_fails_the_job(store: Fresh) {
    let rows = &*store.rows;
    accept(rows, &calibration()).await;
    let claimed = claim(rows).await.unwrap();
    let mut measured = draft(1.5);
    measured.slices[0].scale = f64::NAN;
    let finish = Finish::Succeeded {
        outcome: Box::new(calibration_outcome()),
        warnings: vec![],
        profile: Some(Box::new(measured)),
    };
    assert!(rows.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
    let ended = job(rows, claimed.id).await;
    assert_eq!((ended.state, ended.error.map(|fault| fault.code)), (JobState::Failed, Some(Code::Internal)));
    assert!(rows.profiles(None, None, &page(10, None)).await.unwrap().items.is_empty());
}
