//! Expiry when the wall clock jumps.

use super::{uploads::begun, *};
use crate::store::Retention;

const DAY: Duration = Duration::from_secs(24 * 60 * 60);
const KEEP: Retention = Retention { stacks: Some(DAY), failed: None, uploads: Some(DAY) };
const NOTHING: [Vec<Uuid>; 3] = [Vec::new(), Vec::new(), Vec::new()];
/// To 2099.
const JUMP_MS: i64 = 73 * 365 * 24 * 60 * 60 * 1000;

async fn ended_and_open(metadata: &dyn MetadataStore) -> (Uuid, Uuid) {
    accept(metadata, &stack_with(|request| request.options.keep_days = Some(2))).await;
    let claimed = claim(metadata).await.expect("a job waits");
    assert!(metadata.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    (claimed.id, begun(metadata, 100).await)
}

/// Zips, stacks and uploads that expired.
async fn expired(metadata: &dyn MetadataStore) -> [Vec<Uuid>; 3] {
    [
        metadata.expire_job_uploads(&KEEP).await.unwrap(),
        metadata.delete_expired_jobs(&KEEP).await.unwrap(),
        metadata.delete_expired_uploads().await.unwrap().into_iter().map(|upload| upload.id).collect(),
    ]
}

pub async fn a_clock_that_jumps_expires_nothing(store: Fresh) {
    let metadata = &*store.metadata;
    let (job, upload) = ended_and_open(metadata).await;
    // before the first collection, and after it
    for _ in 0..2 {
        store.clock.set_wall_by(JUMP_MS);
        assert_eq!(expired(metadata).await, NOTHING);
        assert!(metadata.upload(upload).await.unwrap().is_some(), "it can be continued");
        assert!(metadata.take_over_upload(upload).await.unwrap().is_some());
        assert_eq!(metadata.reserved_bytes().await.unwrap(), 100);
        let late = accept(metadata, &stack()).await.id;
        assert_eq!(expired(metadata).await, NOTHING, "a stack that is sent then makes the clock no better");
        assert!(metadata.delete_job(late).await.unwrap());
        store.clock.set_wall_by(-JUMP_MS);
        assert_eq!(expired(metadata).await, NOTHING);
    }
    assert!(metadata.upload(upload).await.unwrap().is_some(), "it waits again");
    store.clock.advance(DAY * 2);
    assert_eq!(expired(metadata).await, [vec![job], vec![job], vec![upload]], "time that passes counts");
}

pub async fn time_that_passes_after_a_jump_counts(store: Fresh) {
    let metadata = &*store.metadata;
    let (job, upload) = ended_and_open(metadata).await;
    assert_eq!(expired(metadata).await, NOTHING);
    store.clock.set_wall_by(JUMP_MS);
    assert_eq!(expired(metadata).await, NOTHING);
    store.clock.advance(DAY);
    assert_eq!(expired(metadata).await, [vec![job], vec![], vec![upload]]);
    store.clock.advance(DAY);
    assert_eq!(expired(metadata).await, [vec![], vec![job], vec![]]);
}
