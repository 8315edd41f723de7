//! Jobs as clients see them: accepted, listed, cancelled, deleted.

use async_trait::async_trait;
use sqlx::Executor;
use uuid::Uuid;

use super::{
    engine::{Connection, Db, Metadata, dialect, id_list},
    quota, scans, search,
    transitions::{apply, state_and_lease},
};
use crate::{
    contract::{JobKind, JobState, Name, request::JobRequest},
    store::{
        BlobOwner, CancelRequest, Enqueue, EnqueueAll, Job, JobCounts, JobFilter, JobQueue, NewJob, Page, PageRequest,
        StoreResult, json,
        rows::{
            JobRow, blob_keys, counts, keep_ms, kind, signed, state,
            transaction::{Lock, Notice},
            transition::Transition,
            turn::{Queue, TurnInput},
            unsigned,
        },
        search::{FoundStacks, terms},
    },
};
use pinstack_science::types::Warning;

#[async_trait]
impl JobQueue for Metadata {
    async fn enqueue(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Enqueue> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let enqueued = insert(self, &mut tx, job, job.owner, queue_limit).await?;
        if let Enqueue::Accepted(_) = &enqueued {
            self.commit(tx, "rows.enqueue", Notice::Arrivals(&[job.id])).await?;
        }
        Ok(enqueued)
    }

    async fn enqueue_all(&self, jobs: &[NewJob], queue_limit: u64) -> StoreResult<EnqueueAll> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let enqueued = insert_all(self, &mut tx, jobs, None, queue_limit).await?;
        if let EnqueueAll::Accepted(_) = &enqueued {
            let ids: Vec<Uuid> = jobs.iter().map(|job| job.id).collect();
            self.commit(tx, "rows.enqueue_all", Notice::Arrivals(&ids)).await?;
        }
        Ok(enqueued)
    }

    async fn by_idempotency_key(&self, key: &str) -> StoreResult<Option<(Job, String)>> {
        find_by_idempotency_key(self.reading(), key).await
    }

    async fn job(&self, id: Uuid) -> StoreResult<Option<Job>> {
        let row: Option<JobRow> = sqlx::query_as("SELECT * FROM jobs WHERE id = $1 AND NOT delete_requested")
            .bind(id)
            .fetch_optional(self.reading())
            .await?;
        row.map(Job::try_from).transpose()
    }

    async fn versions(&self, ids: &[Uuid]) -> StoreResult<Vec<(Uuid, i64)>> {
        let versions = sqlx::query_as(concat!(
            "SELECT id, version FROM jobs WHERE id ",
            dialect!(IN "$1"),
            " AND NOT delete_requested"
        ));
        Ok(versions.bind(id_list(ids)).fetch_all(self.reading()).await?)
    }

    async fn job_kind(&self, id: Uuid) -> StoreResult<Option<JobKind>> {
        let name: Option<String> = sqlx::query_scalar("SELECT kind FROM jobs WHERE id = $1 AND NOT delete_requested")
            .bind(id)
            .fetch_optional(self.reading())
            .await?;
        name.as_deref().map(kind).transpose()
    }

    async fn jobs(&self, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>> {
        search::jobs(self, filter, page).await
    }

    async fn found(&self, filter: &JobFilter) -> StoreResult<FoundStacks> {
        search::found(self, filter).await
    }

    async fn queued(&self, limit: u32) -> StoreResult<Vec<Uuid>> {
        let ids = sqlx::query_scalar(concat!(
            "SELECT id FROM jobs",
            dialect!(INDEXED BY jobs_that_wait),
            " WHERE state = 'queued' AND NOT delete_requested ORDER BY background, turn, seq LIMIT $1"
        ));
        Ok(ids.bind(i64::from(limit)).fetch_all(self.reading()).await?)
    }

    async fn counts(&self) -> StoreResult<JobCounts> {
        let rows: Vec<(String, i64)> =
            sqlx::query_as("SELECT state, count(*) FROM jobs GROUP BY state").fetch_all(self.reading()).await?;
        counts(rows)
    }

    async fn cancel(&self, id: Uuid) -> StoreResult<Option<CancelRequest>> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let now = self.now(&mut *tx).await?;
            let Some((state, held)) = state_and_lease(&mut tx, id, now).await? else { return Ok(None) };
            let answer = match state {
                JobState::Succeeded | JobState::Failed | JobState::Cancelled => {
                    return Ok(Some(CancelRequest::AlreadyEnded(state)));
                }
                JobState::Running if held => {
                    sqlx::query(
                        "UPDATE jobs SET cancel_requested = true, version = version + 1 WHERE id = $1 AND NOT cancel_requested",
                    )
                    .bind(id)
                    .execute(&mut *tx)
                    .await?;
                    CancelRequest::Requested
                }
                // no worker holds it: it is queued, or its lease has expired
                JobState::Queued | JobState::Running => {
                    apply(&mut tx, id, now, &Transition::cancelled()).await?;
                    sqlx::query("UPDATE jobs SET cancel_requested = true WHERE id = $1").bind(id).execute(&mut *tx).await?;
                    CancelRequest::Cancelled
                }
            };
            self.commit(tx, "rows.cancel", Notice::Changes(&[id])).await?;
            Ok(Some(answer))
        })
        .await
    }

    async fn delete_job(&self, id: Uuid) -> StoreResult<bool> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let now = self.now(&mut *tx).await?;
            let Some((state, held)) = state_and_lease(&mut tx, id, now).await? else { return Ok(false) };
            let sql = if state == JobState::Running && held {
                // its idempotency key can be used again at once
                "UPDATE jobs SET cancel_requested = true, delete_requested = true, idempotency_key = NULL, version = version + 1
                 WHERE id = $1"
            } else {
                "DELETE FROM jobs WHERE id = $1"
            };
            sqlx::query(sql).bind(id).execute(&mut *tx).await?;
            self.commit(tx, "rows.delete", Notice::Changes(&[id])).await?;
            Ok(true)
        })
        .await
    }

    async fn blob_owner(&self, id: Uuid) -> StoreResult<Option<BlobOwner>> {
        let row: Option<(String, i64, bool)> =
            sqlx::query_as("SELECT state, lease_token, upload_removed FROM jobs WHERE id = $1")
                .bind(id)
                .fetch_optional(self.reading())
                .await?;
        let owner = |(name, lease_token, upload_removed): (String, i64, bool)| {
            Ok(BlobOwner { state: state(&name)?, lease_token, upload_removed })
        };
        row.map(owner).transpose()
    }

    async fn blob_keys(&self, id: Uuid) -> StoreResult<Vec<String>> {
        let row: Option<(String, Option<String>, bool)> =
            sqlx::query_as("SELECT request, outcome, upload_removed FROM jobs WHERE id = $1")
                .bind(id)
                .fetch_optional(self.reading())
                .await?;
        Ok(row.map(|(request, outcome, removed)| blob_keys(&request, outcome.as_deref(), removed)).unwrap_or_default())
    }
}

/// Enqueues all jobs, which the token `sender` sent, within a transaction that the caller commits if all of them are
/// accepted.
pub(super) async fn insert_all(
    store: &Metadata,
    connection: &mut Connection,
    jobs: &[NewJob],
    sender: Option<Uuid>,
    queue_limit: u64,
) -> StoreResult<EnqueueAll> {
    let mut accepted = Vec::with_capacity(jobs.len());
    let before = waiting(&mut *connection).await?;
    for job in jobs {
        let queue = Queue { waiting: before + accepted.len() as u64, limit: queue_limit };
        match insert_behind(store, &mut *connection, job, sender.or(job.owner), queue).await? {
            Enqueue::Accepted(job) => accepted.push(*job),
            refused => return Ok(EnqueueAll::Refused(refused)),
        }
    }
    Ok(EnqueueAll::Accepted(accepted))
}

/// Enqueues a job, which the token `sender` sent, within a transaction that the caller commits.
pub(super) async fn insert(
    store: &Metadata,
    connection: &mut Connection,
    job: &NewJob,
    sender: Option<Uuid>,
    queue_limit: u64,
) -> StoreResult<Enqueue> {
    let waiting = waiting(&mut *connection).await?;
    insert_behind(store, connection, job, sender, Queue { waiting, limit: queue_limit }).await
}

/// Number of queued jobs. It is counted once for many jobs that are accepted together.
async fn waiting(connection: &mut Connection) -> StoreResult<u64> {
    let waiting = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE state = 'queued'");
    Ok(unsigned(waiting.fetch_one(connection).await?))
}

/// Enqueues a job behind those that wait.
async fn insert_behind(
    store: &Metadata,
    connection: &mut Connection,
    job: &NewJob,
    sender: Option<Uuid>,
    queue: Queue,
) -> StoreResult<Enqueue> {
    if let Some((key, fingerprint)) = &job.idempotency
        && let Some((first, its_fingerprint)) = find_by_idempotency_key(&mut *connection, key).await?
    {
        let same = its_fingerprint == *fingerprint;
        return Ok(if same { Enqueue::Repeated(Box::new(first)) } else { Enqueue::KeyReused });
    }
    if let Some(scan) = job.request.scan()
        && !scans::accepts(&mut *connection, scan, &job.rig, &job.lens).await?
    {
        return Ok(Enqueue::NoSuchScan(scan.clone()));
    }
    if queue.waiting >= queue.limit {
        return Ok(Enqueue::QueueFull { waiting: queue.waiting });
    }
    let now = store.now(&mut *connection).await?;
    if let Some(over) = quota::exceeded(connection, job.owner, own_bytes(&job.request), now).await? {
        return Ok(Enqueue::OverQuota(over));
    }
    let place = TurnInput::of(job, sender);
    let turn = next_turn(&mut *connection, &place).await?;
    let row: JobRow = sqlx::query_as(
        "INSERT INTO jobs (id, kind, rig, lens, scan, request, state, stage, completed, total, fraction, attempt,
                           lease_token, version, created_at, keep_ms, cancel_requested, delete_requested, warnings,
                           idempotency_key, fingerprint, owner, upload_bytes, background, share, turn, turn_end, trace)
         VALUES ($1, $2, $3, $4, $5, $6, 'queued', 'waiting', 0, 0, 0.0, 0, 0, 1, $7, $8, false, false, $9, $10, $11, $12, $13,
                 $14, $15, $16, $17, $18)
         RETURNING *",
    )
    .bind(job.id)
    .bind(job.request.kind().as_str())
    .bind(job.rig.as_str())
    .bind(job.lens.as_str())
    .bind(job.request.scan().map(Name::as_str))
    .bind(json::stored::<JobRequest>("the request of a job", &job.request)?)
    .bind(now)
    .bind(keep_ms(&job.request))
    .bind(json::stored::<Vec<Warning>>("the warnings of a job", &job.warnings)?)
    .bind(job.idempotency.as_ref().map(|(key, _)| key.as_str()))
    .bind(job.idempotency.as_ref().map(|(_, fingerprint)| fingerprint.as_str()))
    .bind(job.owner)
    .bind(signed(own_bytes(&job.request)))
    .bind(place.background)
    .bind(&place.share)
    .bind(turn)
    .bind(turn.saturating_add(place.work))
    .bind(job.trace.as_deref())
    .fetch_one(&mut *connection)
    .await?;
    search::index(connection, row.seq, terms(job.rig.as_str(), job.lens.as_str(), &job.request)).await?;
    Ok(Enqueue::Accepted(Box::new(row.try_into()?)))
}

/// Bytes that a job adds to the store: pictures that a reconstruction reads are results of stacks.
fn own_bytes(request: &JobRequest) -> u64 {
    request.own_upload().map_or(0, |upload| upload.bytes)
}

/// The turn of a job that is accepted now, as [`rows::turn`](crate::store::rows::turn) defines it.
async fn next_turn(connection: &mut Connection, place: &TurnInput) -> StoreResult<i64> {
    let turn = sqlx::query_scalar(
        "SELECT max(turn) FROM (
             SELECT COALESCE((SELECT max(turn) FROM jobs WHERE background = $1 AND started_at IS NOT NULL), 0) - $3 AS turn
             UNION ALL
             SELECT COALESCE((SELECT max(turn_end) FROM jobs WHERE share = $2 AND state <> 'cancelled'), -$3)) AS turns",
    );
    let turn = turn.bind(place.background).bind(&place.share).bind(place.lead);
    Ok(turn.fetch_one(connection).await?)
}

async fn find_by_idempotency_key(
    executor: impl Executor<'_, Database = Db>,
    key: &str,
) -> StoreResult<Option<(Job, String)>> {
    let row: Option<JobRow> =
        sqlx::query_as("SELECT * FROM jobs WHERE idempotency_key = $1").bind(key).fetch_optional(executor).await?;
    let Some(mut row) = row else { return Ok(None) };
    let fingerprint = row.fingerprint.take().unwrap_or_default();
    Ok(Some((row.try_into()?, fingerprint)))
}
