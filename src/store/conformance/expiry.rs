//! What a clock that leaps expires: nothing.

use super::{uploads::begun, *};
use crate::store::Retention;

const DAY: Duration = Duration::from_secs(24 * 60 * 60);
const KEEP: Retention = Retention { stacks: Some(DAY), failed: None, uploads: Some(DAY) };
const NOTHING: [Vec<Uuid>; 3] = [Vec::new(), Vec::new(), Vec::new()];
/// To 2099.
const LEAP_MS: i64 = 73 * 365 * 24 * 60 * 60 * 1000;

async fn ended_and_open(rows: &dyn MetadataStore) -> (Uuid, Uuid) {
    accept(rows, &stack_with(|request| request.options.keep_days = Some(2))).await;
    let claimed = claim(rows).await.expect("a job waits");
    assert!(rows.finish(claimed.id, claimed.lease_token, &success()).await.unwrap());
    (claimed.id, begun(rows, 100).await)
}

/// Zips, stacks and uploads that went.
async fn expired(rows: &dyn MetadataStore) -> [Vec<Uuid>; 3] {
    [
        rows.expire_job_uploads(&KEEP).await.unwrap(),
        rows.delete_expired_jobs(&KEEP).await.unwrap(),
        rows.delete_expired_uploads().await.unwrap(),
    ]
}

pub(crate) async fn a_clock_that_leaps_expires_nothing(store: Fresh) {
    let rows = &*store.rows;
    let (job, upload) = ended_and_open(rows).await;
    // before the first clean-up, and after it
    for _ in 0..2 {
        store.clock.set_wall_by(LEAP_MS);
        assert_eq!(expired(rows).await, NOTHING);
        let late = accept(rows, &stack()).await.id;
        assert_eq!(expired(rows).await, NOTHING, "a stack that is sent then makes the clock no better");
        assert!(rows.delete_job(late).await.unwrap());
        store.clock.set_wall_by(-LEAP_MS);
        assert_eq!(expired(rows).await, NOTHING);
    }
    assert!(rows.upload(upload).await.unwrap().is_some(), "it waits again");
    store.clock.advance(DAY * 2);
    assert_eq!(expired(rows).await, [vec![job], vec![job], vec![upload]], "time that passes counts");
}

pub(crate) async fn after_a_leap_time_that_passes_counts(store: Fresh) {
    let rows = &*store.rows;
    let (job, upload) = ended_and_open(rows).await;
    assert_eq!(expired(rows).await, NOTHING);
    store.clock.set_wall_by(LEAP_MS);
    assert_eq!(expired(rows).await, NOTHING);
    store.clock.advance(DAY);
    assert_eq!(expired(rows).await, [vec![job], vec![], vec![upload]]);
    store.clock.advance(DAY);
    assert_eq!(expired(rows).await, [vec![], vec![job], vec![]]);
}
