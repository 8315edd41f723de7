//! Sums over all rows.

use std::time::Duration;

use uuid::Uuid;

use super::{Fresh, accept, claim, name, stack};
use crate::{
    contract::{Code, Fault, JobKind, JobState},
    store::{Finish, NewJob, Totals, tokens::NewToken, totals::QuotaUse},
};

pub async fn totals_count_jobs_bytes_and_quotas(Fresh { metadata, clock, .. }: Fresh) {
    assert_eq!(metadata.totals().await.unwrap(), Totals::default());
    let owner = Uuid::now_v7();
    let quota =
        |id, text: &str, quota_bytes| NewToken { id, name: name(text), digest: [7; 32], scopes: vec![], quota_bytes };
    assert!(metadata.add_token(&quota(owner, "with", Some(5_000_000))).await.unwrap());
    assert!(metadata.add_token(&quota(Uuid::now_v7(), "without", None)).await.unwrap());
    assert!(metadata.add_token(&quota(Uuid::now_v7(), "revoked", Some(1))).await.unwrap());
    assert!(metadata.revoke_token(&name("revoked")).await.unwrap());
    let first = accept(&*metadata, &NewJob { owner: Some(owner), ..stack() }).await;
    let oldest = first.created_at;
    clock.advance(Duration::from_secs(60));
    let second = accept(&*metadata, &stack()).await;
    let bytes = first.request.upload().bytes;

    let totals = metadata.totals().await.unwrap();
    let [queued] = &totals.jobs[..] else { panic!("{totals:?}") };
    assert_eq!((queued.kind, queued.state, queued.count), (JobKind::Stack, JobState::Queued, 2));
    assert_eq!((queued.upload_bytes, queued.result_bytes, queued.oldest), (2 * bytes, 0, oldest));
    assert_eq!(totals.quotas, [QuotaUse { quota: 5_000_000, used: bytes }]);
    assert_eq!(totals.quotas[0].used, metadata.used_bytes(owner).await.unwrap());

    let claimed = claim(&*metadata).await.expect("a job waits");
    let fault = Fault::new(Code::InvalidImage, "torn");
    assert!(metadata.finish(claimed.id, claimed.lease_token, &Finish::Failed(fault)).await.unwrap());
    let totals = metadata.totals().await.unwrap();
    let of = |state| totals.jobs.iter().find(|jobs| jobs.state == state).map(|jobs| (jobs.count, jobs.oldest));
    assert_eq!(of(JobState::Queued), Some((1, second.created_at)));
    assert_eq!(of(JobState::Failed), Some((1, oldest)));
}
