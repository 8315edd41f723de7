//! Claim, heartbeat, release: how a worker holds a job.
//!
//! Every write that a worker makes is fenced: `WHERE id = ? AND lease_token = ? AND state = 'running'`.

use std::time::Duration;

use async_trait::async_trait;
use sqlx::SqliteConnection;
use uuid::Uuid;

use super::{SqliteMetadata, StoreResult, transitions};
use crate::{
    contract::{Code, JobKind, Progress},
    store::{
        Attempt, Finish, Heartbeat, Job, Leases,
        clock::{later, millis},
        rows::{
            JobRow,
            expired_leases::{Lease, LeaseRow, MAX_PAUSE, fraction, release_values},
            kind,
            transition::{unreadable, worker_lost},
        },
    },
    telemetry::events,
};

#[async_trait]
impl Leases for SqliteMetadata {
    async fn claim(&self, lease: Duration, max_attempts: u32) -> StoreResult<Option<Job>> {
        let now = self.clock.now_ms();
        let mut tx = self.write().await?;
        let lost = expired_leases(self, &mut tx, lease, now).await?;
        let Ended { ids: ended, failed } = end_lost_jobs(&mut tx, now, &lost, max_attempts).await?;
        let row: Option<JobRow> = sqlx::query_as(
            "UPDATE jobs
             SET state = 'running', stage = 'starting', completed = 0, total = 0, fraction = 0.0,
                 attempt = attempt + 1, lease_token = lease_token + 1, lease_until = ?1, lease_ms = ?4,
                 version = version + 1, claim_after = NULL, started_at = COALESCE(started_at, ?2)
             WHERE seq = COALESCE(
                 (SELECT seq FROM jobs WHERE state = 'running' AND id IN (SELECT unhex(value) FROM json_each(?3))
                  ORDER BY background, turn, seq LIMIT 1),
                 -- without a statistic of the table, SQLite would sort the whole queue
                 (SELECT seq FROM jobs INDEXED BY jobs_that_wait
                  WHERE state = 'queued' AND (claim_after IS NULL OR claim_after <= ?2 OR claim_after > ?2 + ?5)
                  ORDER BY background, turn, seq LIMIT 1))
             RETURNING *",
        )
        .bind(later(now, lease))
        .bind(now)
        .bind(&lost)
        .bind(millis(lease))
        .bind(millis(MAX_PAUSE))
        .fetch_optional(&mut *tx)
        .await?;
        self.commit(tx, "rows.claim").await?;
        for kind in failed {
            events::failed(kind, Code::WorkerLost);
        }
        let claimed = row.as_ref().map(|row| (row.id, row.lease_token));
        let job = match row.map(Job::try_from).transpose() {
            Ok(job) => job,
            Err(error) => {
                if let Some((id, token)) = claimed {
                    transitions::finish(self, id, token, &unreadable(id, &error)).await?;
                }
                return self.claim(lease, max_attempts).await;
            }
        };
        if let Some(job) = &job {
            let given = Lease { token: job.lease_token, until: later(now, lease), length: lease };
            self.observer.granted(job.id, given, self.clock.steady());
        }
        for id in ended.into_iter().chain(job.as_ref().map(|job| job.id)) {
            self.changed(id);
        }
        Ok(job)
    }

    async fn heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat> {
        let mut tx = self.write().await?;
        // the right-hand sides refer to the row before the update, so only new progress increments the version
        let beat: Option<(bool, i64)> = sqlx::query_as(
            "UPDATE jobs
             SET lease_until = ?3, lease_ms = ?8,
                 version = version + ((stage, completed, total, fraction) IS NOT (?4, ?5, ?6, ?7)),
                 stage = ?4, completed = ?5, total = ?6, fraction = ?7
             WHERE id = ?1 AND lease_token = ?2 AND state = 'running'
             RETURNING cancel_requested, version",
        )
        .bind(id)
        .bind(lease_token)
        .bind(later(self.clock.now_ms(), lease))
        .bind(&progress.stage)
        .bind(progress.completed)
        .bind(progress.total)
        .bind(fraction(progress))
        .bind(millis(lease))
        .fetch_optional(&mut *tx)
        .await?;
        self.commit(tx, "rows.heartbeat").await?;
        let Some((cancel_requested, _)) = beat else { return Ok(Heartbeat::Lost) };
        self.changed(id);
        Ok(if cancel_requested { Heartbeat::CancelRequested } else { Heartbeat::Alive })
    }

    async fn finish(&self, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
        transitions::finish(self, id, lease_token, finish).await
    }

    async fn release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool> {
        let now = self.clock.now_ms();
        let (uncounted, claim_after) = release_values(attempt, now);
        let mut tx = self.write().await?;
        let deleted = sqlx::query(
            "DELETE FROM jobs WHERE id = ?1 AND lease_token = ?2 AND state = 'running' AND delete_requested = 1",
        )
        .bind(id)
        .bind(lease_token)
        .execute(&mut *tx)
        .await?;
        let released = sqlx::query(
            "UPDATE jobs
             SET state = iif(cancel_requested, 'cancelled', 'queued'),
                 finished_at = iif(cancel_requested, ?3, NULL),
                 stage = iif(cancel_requested, stage, 'waiting'),
                 completed = iif(cancel_requested, completed, 0),
                 total = iif(cancel_requested, total, 0),
                 fraction = iif(cancel_requested, fraction, 0.0),
                 attempt = attempt - ?4, claim_after = ?5, lease_until = NULL, version = version + 1
             WHERE id = ?1 AND lease_token = ?2 AND state = 'running'",
        )
        .bind(id)
        .bind(lease_token)
        .bind(now)
        .bind(uncounted)
        .bind(claim_after)
        .execute(&mut *tx)
        .await?;
        self.commit(tx, "rows.release").await?;
        let held = deleted.rows_affected() + released.rows_affected() > 0;
        if held {
            self.changed(id);
            self.arrived();
        }
        Ok(held)
    }
}

/// The jobs whose lease has expired, as a JSON list of their ids in hex.
async fn expired_leases(
    store: &SqliteMetadata,
    connection: &mut SqliteConnection,
    lease: Duration,
    now: i64,
) -> StoreResult<String> {
    let rows: Vec<LeaseRow> =
        sqlx::query_as("SELECT id, lease_token, COALESCE(lease_until, 0), lease_ms FROM jobs WHERE state = 'running'")
            .fetch_all(connection)
            .await?;
    let leases: Vec<(Uuid, Lease)> = rows.iter().map(|row| Lease::of_row(row, lease)).collect();
    let lost = store.observer.expired(&leases, now, store.clock.steady());
    Ok(serde_json::to_string(&lost.iter().map(|id| id.simple().to_string()).collect::<Vec<_>>())?)
}

/// Jobs that ended because their worker was lost.
struct Ended {
    /// All of them.
    ids: Vec<Uuid>,
    /// The kinds of those that failed.
    failed: Vec<JobKind>,
}

/// Ends the jobs with an expired lease that must not be claimed again: deleted, cancelled, or out of attempts.
async fn end_lost_jobs(
    connection: &mut SqliteConnection,
    now: i64,
    lost: &str,
    max_attempts: u32,
) -> StoreResult<Ended> {
    let mut ended: Vec<Uuid> = sqlx::query_scalar(
        "DELETE FROM jobs
         WHERE state = 'running' AND id IN (SELECT unhex(value) FROM json_each(?1)) AND delete_requested = 1
         RETURNING id",
    )
    .bind(lost)
    .fetch_all(&mut *connection)
    .await?;
    ended.extend(
        sqlx::query_scalar::<_, Uuid>(
            "UPDATE jobs SET state = 'cancelled', finished_at = ?1, lease_until = NULL, version = version + 1
             WHERE state = 'running' AND id IN (SELECT unhex(value) FROM json_each(?2)) AND cancel_requested = 1
             RETURNING id",
        )
        .bind(now)
        .bind(lost)
        .fetch_all(&mut *connection)
        .await?,
    );
    let failed: Vec<(Uuid, String)> = sqlx::query_as(
        "UPDATE jobs
             SET state = 'failed', error = ?3, finished_at = ?1, lease_until = NULL, version = version + 1
             WHERE state = 'running' AND id IN (SELECT unhex(value) FROM json_each(?4)) AND attempt >= ?2
             RETURNING id, kind",
    )
    .bind(now)
    .bind(max_attempts)
    .bind(worker_lost(max_attempts)?)
    .bind(lost)
    .fetch_all(&mut *connection)
    .await?;
    ended.extend(failed.iter().map(|(id, _)| *id));
    let kinds: StoreResult<Vec<JobKind>> = failed.iter().map(|(_, name)| kind(name)).collect();
    Ok(Ended { ids: ended, failed: kinds? })
}
