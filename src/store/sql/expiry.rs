//! Expiry of jobs and of their zips.

use async_trait::async_trait;
use uuid::Uuid;

use super::{clock_gaps, engine::Metadata};
use crate::store::{
    Expiry, Retention, StoreResult,
    clock::millis,
    rows::transaction::{Lock, Notice},
};

/// Most rows that one transaction changes: what it writes to the journal must fit on a disk that is almost full.
const AT_A_TIME: i64 = 100;

#[async_trait]
impl Expiry for Metadata {
    async fn delete_expired_jobs(&self, keep: &Retention) -> StoreResult<Vec<Uuid>> {
        self.reserve_space().await;
        self.freeing(|| async {
            clock_gaps::observe(self).await?;
            let mut tx = self.write_alone(Lock::Expiry).await?;
            let now = self.now(&mut *tx).await?;
            // keep_days of the job itself comes first; a succeeded calibration is kept, because profiles refer to it
            let gone: Vec<Uuid> = sqlx::query_scalar(
                "DELETE FROM jobs WHERE id IN (
                     SELECT id FROM jobs
                     WHERE finished_at + COALESCE(keep_ms, CASE
                               WHEN state IN ('failed', 'cancelled') THEN $2
                               WHEN state = 'succeeded' AND kind <> 'calibration' THEN $3
                           END) + (SELECT CAST(COALESCE(SUM(gap_ms), 0) AS bigint) FROM clock_gaps WHERE at_ms > finished_at) <= $1
                       AND state IN ('succeeded', 'failed', 'cancelled')
                     LIMIT $4)
                 RETURNING id",
            )
            .bind(now)
            .bind(keep.failed.map(millis))
            .bind(keep.stacks.map(millis))
            .bind(AT_A_TIME)
            .fetch_all(&mut *tx)
            .await?;
            self.commit(tx, "rows.expire", Notice::Changes(&gone)).await?;
            Ok(gone)
        })
        .await
    }

    async fn expire_job_uploads(&self, keep: &Retention) -> StoreResult<Vec<Uuid>> {
        self.freeing(|| async {
            let Some(uploads) = keep.uploads else { return Ok(Vec::new()) };
            clock_gaps::observe(self).await?;
            let mut tx = self.write_alone(Lock::Expiry).await?;
            let now = self.now(&mut *tx).await?;
            let gone: Vec<Uuid> = sqlx::query_scalar(
                "UPDATE jobs SET upload_removed = true, upload_bytes = 0 WHERE id IN (
                     SELECT id FROM jobs
                     WHERE state = 'succeeded' AND NOT upload_removed AND kind <> 'reconstruction'
                       AND finished_at + $2 + (SELECT CAST(COALESCE(SUM(gap_ms), 0) AS bigint) FROM clock_gaps WHERE at_ms > finished_at) <= $1
                     LIMIT $3)
                 RETURNING id",
            )
            .bind(now)
            .bind(millis(uploads))
            .bind(AT_A_TIME)
            .fetch_all(&mut *tx)
            .await?;
            self.commit(tx, "rows.expire_job_uploads", Notice::None).await?;
            Ok(gone)
        })
        .await
    }

    async fn confirm_clock(&self) -> StoreResult<()> {
        self.freeing(|| clock_gaps::confirm(self)).await
    }
}
