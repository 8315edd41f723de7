//! Finding jobs by words, names, times and verdicts.

use super::*;
use crate::{
    contract::{Code, Fault, JobKind, JobState, Verdict, request::JobRequest},
    store::{Finish, JobFilter, search::FoundStacks},
};
use pinstack_science::types::{Warning, WarningCode};

fn labelled(label: &str) -> NewJob {
    stack_with(|request| request.options.label = Some(label.into()))
}

async fn found(metadata: &dyn MetadataStore, filter: JobFilter) -> Vec<Uuid> {
    let filter = JobFilter { kind: Some(JobKind::Stack), ..filter };
    let mut ids = Vec::new();
    let mut cursor = None;
    loop {
        let part = metadata.jobs(&filter, &page(1, cursor)).await.unwrap();
        ids.extend(part.items.iter().map(|job| job.id));
        cursor = part.next_cursor;
        if cursor.is_none() {
            return ids;
        }
    }
}

/// Claims the next job and ends it with a warning of this code.
async fn warned(metadata: &dyn MetadataStore, code: WarningCode) {
    let claimed = claim(metadata).await.expect("one waits");
    let warnings = vec![Warning::new(code, "x")];
    let finish = Finish::Succeeded { outcome: Box::new(stack_outcome()), warnings, profile: None };
    assert!(metadata.finish(claimed.id, claimed.lease_token, &finish).await.unwrap());
}

pub async fn jobs_are_found_by_words_names_times_and_how_they_ended(store: Fresh) {
    let metadata = &*store.metadata;
    let begin = accept(metadata, &calibration()).await.created_at;
    let first = accept(metadata, &labelled("K\u{e4}fer one")).await.id;
    store.clock.advance(Duration::from_secs(60));
    let second = accept(metadata, &labelled("k\u{e4}fer two")).await;
    let q = |text: &str| JobFilter { q: Some(text.into()), ..JobFilter::default() };
    let all = JobFilter::default();
    assert_eq!(found(metadata, q("ka\u{308}f")).await, [second.id, first]);
    assert_eq!(found(metadata, q("K\u{c4}FER on")).await, [first]);
    assert!(found(metadata, q("kafer")).await.is_empty());
    assert_eq!(found(metadata, JobFilter { rig: Some(name("rig")), ..q("two") }).await, [second.id]);
    assert!(found(metadata, JobFilter { rig: Some(name("other")), ..q("two") }).await.is_empty());
    assert_eq!(found(metadata, JobFilter { since: Some(second.created_at), ..all.clone() }).await, [second.id]);
    assert_eq!(found(metadata, JobFilter { until: Some(second.created_at), ..q("k\u{e4}fer") }).await, [first]);
    assert!(found(metadata, JobFilter { until: Some(begin), ..all.clone() }).await.is_empty());

    let calibration = claim(metadata).await.expect("it comes first");
    metadata.finish(calibration.id, calibration.lease_token, &Finish::Cancelled).await.unwrap();
    warned(metadata, WarningCode::SlicesReversed).await;
    let claimed = claim(metadata).await.expect("the second waits");
    let fault = Finish::Failed(Fault::new(Code::Internal, "x"));
    assert!(metadata.finish(claimed.id, claimed.lease_token, &fault).await.unwrap());
    let bad = JobFilter { verdict: Some(Verdict::DoNotUse), ..all.clone() };
    assert_eq!(found(metadata, bad.clone()).await, [first]);
    assert_eq!(found(metadata, JobFilter { state: Some(JobState::Failed), ..q("k\u{e4}f") }).await, [second.id]);
    let again = accept(metadata, &stack_with(|request| request.upload.sha256 = "other".into())).await.id;
    let of_zip = |digest: &str| JobFilter { zip: Some(digest.into()), ..JobFilter::default() };
    assert_eq!(found(metadata, of_zip("other")).await, [again]);
    let JobRequest::Stack(sent) = second.request else { panic!("it is a stack") };
    assert_eq!(found(metadata, of_zip(&sent.upload.sha256)).await, [second.id, first]);
    metadata.delete_job(again).await.unwrap();
    let numbers = FoundStacks { all: 2, verdicts: [0, 0, 1], failed: 1 };
    assert_eq!(metadata.found(&q("k\u{e4}fer")).await.unwrap(), numbers);
    assert_eq!(metadata.found(&bad).await.unwrap(), numbers, "the verdict is left out");
    let of_other = JobFilter { owner: Some(Uuid::now_v7()), ..all };
    assert_eq!(metadata.found(&of_other).await.unwrap(), numbers, "jobs without a token are seen by all");
    metadata.delete_job(first).await.unwrap();
    assert_eq!(metadata.found(&bad).await.unwrap(), FoundStacks { all: 1, failed: 1, ..FoundStacks::default() });
}

pub async fn another_version_of_the_index_is_made_anew(store: Fresh) {
    let metadata = &*store.metadata;
    let first = accept(metadata, &labelled("wasp")).await.id;
    warned(metadata, WarningCode::Clipped).await;
    metadata.close().await;
    for sql in ["DELETE FROM search_terms RETURNING term", "UPDATE search_index SET version = 0 RETURNING ''"] {
        store.database.execute(sql).await.unwrap();
    }
    let again = store.database.open(store.clock.clone()).await.unwrap();
    let filter = JobFilter { q: Some("was".into()), verdict: Some(Verdict::Look), ..JobFilter::default() };
    assert_eq!(found(&*again, filter).await, [first]);
}
