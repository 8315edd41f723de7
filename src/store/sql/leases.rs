//! Claim, heartbeat, release: how a worker holds a job.
//!
//! Every write that a worker makes is fenced: `WHERE id = ? AND lease_token = ? AND state = 'running'`.

use std::time::Duration;

use async_trait::async_trait;
use uuid::Uuid;

use super::{
    engine::{Connection, Metadata, answered, dialect, id_list},
    search, transitions,
};
use crate::{
    contract::{Code, JobKind, Progress},
    store::{
        Attempt, Finish, Heartbeat, Job, Leases, StoreResult,
        clock::{later, millis},
        rows::{
            JobRow,
            expired_leases::{Lease, LeaseRow, MAX_PAUSE, fraction, release_values},
            kind,
            transaction::Notice,
            transition::{unreadable, worker_lost},
        },
        search::FAILED,
    },
    telemetry::events,
};

#[async_trait]
impl Leases for Metadata {
    async fn claim(&self, lease: Duration, max_attempts: u32, except: Option<JobKind>) -> StoreResult<Option<Job>> {
        self.observer.reached(answered(self.try_claim(lease, max_attempts, except)).await)
    }

    async fn heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat> {
        self.observer.reached(answered(self.try_heartbeat(id, lease_token, lease, progress)).await)
    }

    async fn finish(&self, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
        self.observer.reached(answered(self.freeing(|| transitions::finish(self, id, lease_token, finish))).await)
    }

    async fn release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool> {
        self.observer.reached(answered(self.freeing(|| self.try_release(id, lease_token, attempt))).await)
    }
}

impl Metadata {
    async fn try_claim(&self, lease: Duration, max_attempts: u32, except: Option<JobKind>) -> StoreResult<Option<Job>> {
        let mut tx = self.write().await?;
        let now = self.now(&mut *tx).await?;
        let lost = expired_leases(self, &mut tx, now).await?;
        let Ended { ids: ended, failed } = end_lost_jobs(&mut tx, now, &lost, max_attempts).await?;
        let row: Option<JobRow> = sqlx::query_as(concat!(
            "UPDATE jobs
             SET state = 'running', stage = 'starting', completed = 0, total = 0, fraction = 0.0,
                 attempt = attempt + 1, lease_token = lease_token + 1, lease_until = $1, lease_ms = $4,
                 version = version + 1, claim_after = NULL, started_at = COALESCE(started_at, $2)
             WHERE seq = COALESCE(
                 (SELECT seq FROM jobs WHERE state = 'running' AND id ",
            dialect!(IN "$3"),
            "
                    AND ($6 IS NULL OR kind <> $6)
                  ORDER BY background, turn, seq LIMIT 1),
                 (SELECT seq FROM jobs",
            dialect!(INDEXED BY jobs_that_wait),
            "
                  WHERE state = 'queued' AND (claim_after IS NULL OR claim_after <= $2 OR claim_after > $2 + $5)
                    AND ($6 IS NULL OR kind <> $6)
                  ORDER BY background, turn, seq LIMIT 1",
            dialect!(FOR UPDATE SKIP LOCKED),
            "))
             RETURNING *"
        ))
        .bind(later(now, lease))
        .bind(now)
        .bind(id_list(&lost))
        .bind(millis(lease))
        .bind(millis(MAX_PAUSE))
        .bind(except.map(JobKind::as_str))
        .fetch_optional(&mut *tx)
        .await?;
        let changed: Vec<Uuid> = ended.into_iter().chain(row.as_ref().map(|row| row.id)).collect();
        self.commit(tx, "rows.claim", Notice::Changes(&changed)).await?;
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
                return Box::pin(self.try_claim(lease, max_attempts, except)).await;
            }
        };
        if let Some(job) = &job {
            let given = Lease { token: job.lease_token, until: later(now, lease), length: lease };
            self.observer.granted(job.id, given, self.clock.steady());
        }
        Ok(job)
    }

    async fn try_heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat> {
        let mut tx = self.write().await?;
        let now = self.now(&mut *tx).await?;
        // the right-hand sides refer to the row before the update, so only new progress increments the version
        let beat: Option<(bool, i64)> = sqlx::query_as(
            "UPDATE jobs
             SET lease_until = $3, lease_ms = $8,
                 version = version + CASE WHEN (stage, completed, total, fraction) IS DISTINCT FROM ($4, $5, $6, $7)
                                     THEN 1 ELSE 0 END,
                 stage = $4, completed = $5, total = $6, fraction = $7
             WHERE id = $1 AND lease_token = $2 AND state = 'running'
             RETURNING cancel_requested, version",
        )
        .bind(id)
        .bind(lease_token)
        .bind(later(now, lease))
        .bind(&progress.stage)
        .bind(i64::from(progress.completed))
        .bind(i64::from(progress.total))
        .bind(fraction(progress))
        .bind(millis(lease))
        .fetch_optional(&mut *tx)
        .await?;
        let Some((cancel_requested, _)) = beat else { return Ok(Heartbeat::Lost) };
        self.commit(tx, "rows.heartbeat", Notice::Changes(&[id])).await?;
        Ok(if cancel_requested { Heartbeat::CancelRequested } else { Heartbeat::Alive })
    }

    async fn try_release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool> {
        let mut tx = self.write().await?;
        let now = self.now(&mut *tx).await?;
        let (uncounted, claim_after) = release_values(attempt, now);
        // a deletion that is requested between the two statements below would be forgotten
        let row = concat!("SELECT 1 FROM jobs WHERE id = $1", dialect!(FOR UPDATE));
        sqlx::query(row).bind(id).execute(&mut *tx).await?;
        let deleted = sqlx::query(
            "DELETE FROM jobs WHERE id = $1 AND lease_token = $2 AND state = 'running' AND delete_requested",
        )
        .bind(id)
        .bind(lease_token)
        .execute(&mut *tx)
        .await?;
        let released = sqlx::query(
            "UPDATE jobs
             SET state = CASE WHEN cancel_requested THEN 'cancelled' ELSE 'queued' END,
                 finished_at = CASE WHEN cancel_requested THEN $3 ELSE NULL END,
                 stage = CASE WHEN cancel_requested THEN stage ELSE 'waiting' END,
                 completed = CASE WHEN cancel_requested THEN completed ELSE 0 END,
                 total = CASE WHEN cancel_requested THEN total ELSE 0 END,
                 fraction = CASE WHEN cancel_requested THEN fraction ELSE 0.0 END,
                 attempt = attempt - $4, claim_after = $5, lease_until = NULL, version = version + 1
             WHERE id = $1 AND lease_token = $2 AND state = 'running'",
        )
        .bind(id)
        .bind(lease_token)
        .bind(now)
        .bind(uncounted)
        .bind(claim_after)
        .execute(&mut *tx)
        .await?;
        let held = deleted.rows_affected() + released.rows_affected() > 0;
        let ids = [id];
        self.commit(tx, "rows.release", if held { Notice::Arrivals(&ids) } else { Notice::None }).await?;
        Ok(held)
    }
}

/// The jobs whose lease has expired. Their rows are locked until the transaction ends. A row that another transaction
/// holds, or that changed since it was read, is left out: its worker lives, or another process takes the job.
async fn expired_leases(store: &Metadata, connection: &mut Connection, now: i64) -> StoreResult<Vec<Uuid>> {
    macro_rules! running {
        () => {
            "SELECT id, lease_token, COALESCE(lease_until, 0), COALESCE(lease_ms, 0) FROM jobs WHERE state = 'running'"
        };
    }
    let rows: Vec<LeaseRow> = sqlx::query_as(running!()).fetch_all(&mut *connection).await?;
    let leases: Vec<(Uuid, Lease)> = rows.iter().map(Lease::of_row).collect();
    let lost = store.observer.expired(&leases, now, store.clock.steady());
    if lost.is_empty() {
        return Ok(lost);
    }
    let locked: Vec<LeaseRow> =
        sqlx::query_as(concat!(running!(), " AND id ", dialect!(IN "$1"), dialect!(FOR UPDATE SKIP LOCKED)))
            .bind(id_list(&lost))
            .fetch_all(connection)
            .await?;
    Ok(locked.into_iter().filter(|row| rows.contains(row)).map(|row| row.0).collect())
}

/// Jobs that ended because their worker was lost.
struct Ended {
    /// All of them.
    ids: Vec<Uuid>,
    /// The kinds of those that failed.
    failed: Vec<JobKind>,
}

/// Ends the jobs with an expired lease that must not be claimed again: deleted, cancelled, or out of attempts.
async fn end_lost_jobs(connection: &mut Connection, now: i64, lost: &[Uuid], max_attempts: u32) -> StoreResult<Ended> {
    let mut ended: Vec<Uuid> = sqlx::query_scalar(concat!(
        "DELETE FROM jobs WHERE state = 'running' AND delete_requested AND id ",
        dialect!(IN "$1"),
        " RETURNING id"
    ))
    .bind(id_list(lost))
    .fetch_all(&mut *connection)
    .await?;
    ended.extend(
        sqlx::query_scalar::<_, Uuid>(concat!(
            "UPDATE jobs SET state = 'cancelled', finished_at = $1, lease_until = NULL, version = version + 1
             WHERE state = 'running' AND cancel_requested AND id ",
            dialect!(IN "$2"),
            " RETURNING id"
        ))
        .bind(now)
        .bind(id_list(lost))
        .fetch_all(&mut *connection)
        .await?,
    );
    let failed: Vec<(Uuid, String)> = sqlx::query_as(concat!(
        "UPDATE jobs
         SET state = 'failed', error = $3, finished_at = $1, lease_until = NULL, version = version + 1
         WHERE state = 'running' AND attempt >= $2 AND id ",
        dialect!(IN "$4"),
        " RETURNING id, kind"
    ))
    .bind(now)
    .bind(i64::from(max_attempts))
    .bind(worker_lost(max_attempts)?)
    .bind(id_list(lost))
    .fetch_all(&mut *connection)
    .await?;
    for (id, _) in &failed {
        search::index_end(&mut *connection, *id, FAILED).await?;
        ended.push(*id);
    }
    let kinds: StoreResult<Vec<JobKind>> = failed.iter().map(|(_, name)| kind(name)).collect();
    Ok(Ended { ids: ended, failed: kinds? })
}
