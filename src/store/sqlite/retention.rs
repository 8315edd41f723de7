//! What is over its time, and what a token's stacks and uploads take.

use std::time::Duration;

use sqlx::{Executor, Sqlite};
use uuid::Uuid;

use super::{Retention, SqliteRows, StoreResult, observed, uploads::unsigned};

pub(super) async fn delete_expired(store: &SqliteRows, keep: &Retention) -> StoreResult<Vec<Uuid>> {
    observed::observe(store).await?;
    let mut tx = store.write().await?;
    // what a job says itself comes first; a calibration that went well is kept: profiles name it
    let gone: Vec<Uuid> = sqlx::query_scalar(
        "DELETE FROM jobs
         WHERE finished_at + COALESCE(keep_ms, CASE
                   WHEN state IN ('failed', 'cancelled') THEN ?2
                   WHEN state = 'succeeded' AND kind = 'stack' THEN ?3
               END) + (SELECT COALESCE(SUM(gap_ms), 0) FROM clock_gaps WHERE at_ms > finished_at) <= ?1
           AND state IN ('succeeded', 'failed', 'cancelled')
         RETURNING id",
    )
    .bind(store.clock.now_ms())
    .bind(keep.failed.map(millis))
    .bind(keep.stacks.map(millis))
    .fetch_all(&mut *tx)
    .await?;
    store.commit(tx, "rows.expire").await?;
    for id in &gone {
        store.changed(*id);
    }
    Ok(gone)
}

pub(super) async fn expire_job_uploads(store: &SqliteRows, keep: &Retention) -> StoreResult<Vec<Uuid>> {
    let Some(uploads) = keep.uploads else { return Ok(Vec::new()) };
    observed::observe(store).await?;
    let mut tx = store.write().await?;
    let gone: Vec<Uuid> = sqlx::query_scalar(
        "UPDATE jobs SET upload_removed = 1, upload_bytes = 0
         WHERE state = 'succeeded' AND upload_removed = 0
           AND finished_at + ?2 + (SELECT COALESCE(SUM(gap_ms), 0) FROM clock_gaps WHERE at_ms > finished_at) <= ?1
         RETURNING id",
    )
    .bind(store.clock.now_ms())
    .bind(millis(uploads))
    .fetch_all(&mut *tx)
    .await?;
    store.commit(tx, "rows.expire_job_uploads").await?;
    Ok(gone)
}

pub(super) async fn bytes_of(store: &SqliteRows, owner: Uuid) -> StoreResult<u64> {
    Ok(unsigned(bytes_taken(&store.readers, owner, store.clock.now_ms()).await?))
}

/// Bytes that the stacks, calibrations and open uploads of a token take.
pub(super) async fn bytes_taken(
    executor: impl Executor<'_, Database = Sqlite>,
    owner: Uuid,
    now: i64,
) -> StoreResult<i64> {
    let bytes = sqlx::query_scalar(
        "SELECT (SELECT COALESCE(SUM(upload_bytes + result_bytes), 0) FROM jobs WHERE owner = ?1)
              + (SELECT COALESCE(SUM(length), 0) FROM uploads
                 WHERE owner = ?1 AND job_kind IS NULL AND fault IS NULL AND expires_at > ?2)",
    )
    .bind(owner)
    .bind(now)
    .fetch_one(executor)
    .await?;
    Ok(bytes)
}

fn millis(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX)
}
