//! Accepting jobs, and reading them.

use anyhow::Context;
use sqlx::{Executor, Sqlite, SqliteConnection};
use uuid::Uuid;

use super::{
    BlobOwner, Enqueue, Job, JobCounts, JobFilter, NewJob, Page, PageRequest, SqliteRows, StoreResult,
    page::Window,
    quota,
    row::{JobRow, kind, state},
    uploads::signed,
};
use crate::{
    contract::{JobKind, JobState, Name, request::JobRequest},
    store::{Skipped, json},
};
use pinstack_science::types::Warning;

/// What a day has.
const MS_PER_DAY: i64 = 24 * 60 * 60 * 1000;

pub(super) async fn enqueue(store: &SqliteRows, job: &NewJob, queue_limit: u64) -> StoreResult<Enqueue> {
    let mut tx = store.write().await?;
    let enqueued = insert(store, &mut tx, job, queue_limit).await?;
    if let Enqueue::Accepted(_) = &enqueued {
        store.commit(tx, "rows.enqueue").await?;
        store.changed(job.id);
    }
    Ok(enqueued)
}

/// Puts a job into the queue, as part of a transaction that the caller commits.
pub(super) async fn insert(
    store: &SqliteRows,
    connection: &mut SqliteConnection,
    job: &NewJob,
    queue_limit: u64,
) -> StoreResult<Enqueue> {
    if let Some((key, fingerprint)) = &job.idempotency
        && let Some((first, its_fingerprint)) = by_idempotency_key(&mut *connection, key).await?
    {
        let same = its_fingerprint == *fingerprint;
        return Ok(if same { Enqueue::Repeated(Box::new(first)) } else { Enqueue::KeyReused });
    }
    let waiting: i64 =
        sqlx::query_scalar("SELECT count(*) FROM jobs WHERE state = 'queued'").fetch_one(&mut *connection).await?;
    let waiting = u64::try_from(waiting).unwrap_or(0);
    if waiting >= queue_limit {
        return Ok(Enqueue::QueueFull { waiting });
    }
    let now = store.clock.now_ms();
    if let Some(over) = quota::exceeded(connection, job.owner, job.request.upload().bytes, now).await? {
        return Ok(Enqueue::OverQuota(over));
    }
    let row: JobRow = sqlx::query_as(
        "INSERT INTO jobs (id, kind, rig, lens, scan, request, state, stage, completed, total, fraction, attempt,
                           lease_token, version, created_at, keep_ms, cancel_requested, delete_requested, warnings,
                           idempotency_key, fingerprint, owner, upload_bytes)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, 'queued', 'waiting', 0, 0, 0.0, 0, 0, 1, ?7, ?8, 0, 0, ?9, ?10, ?11, ?12, ?13)
         RETURNING *",
    )
    .bind(job.id)
    .bind(kind_name(job.request.kind()))
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
    .bind(signed(job.request.upload().bytes))
    .fetch_one(&mut *connection)
    .await?;
    Ok(Enqueue::Accepted(Box::new(row.try_into()?)))
}

pub(super) async fn by_idempotency_key(
    executor: impl Executor<'_, Database = Sqlite>,
    key: &str,
) -> StoreResult<Option<(Job, String)>> {
    let row: Option<JobRow> =
        sqlx::query_as("SELECT * FROM jobs WHERE idempotency_key = ?1").bind(key).fetch_optional(executor).await?;
    let Some(mut row) = row else { return Ok(None) };
    let fingerprint = row.fingerprint.take().unwrap_or_default();
    Ok(Some((row.try_into()?, fingerprint)))
}

pub(super) async fn get(store: &SqliteRows, id: Uuid) -> StoreResult<Option<Job>> {
    let row: Option<JobRow> = sqlx::query_as("SELECT * FROM jobs WHERE id = ?1 AND delete_requested = 0")
        .bind(id)
        .fetch_optional(&store.readers)
        .await?;
    row.map(Job::try_from).transpose()
}

pub(super) async fn kind_of(store: &SqliteRows, id: Uuid) -> StoreResult<Option<JobKind>> {
    let name: Option<String> = sqlx::query_scalar("SELECT kind FROM jobs WHERE id = ?1 AND delete_requested = 0")
        .bind(id)
        .fetch_optional(&store.readers)
        .await?;
    name.as_deref().map(kind).transpose()
}

pub(super) async fn list(store: &SqliteRows, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>> {
    let window = Window::of(page)?;
    let rows = sqlx::query_as(
        "SELECT * FROM jobs
         WHERE seq < ?1 AND delete_requested = 0
           AND (?2 IS NULL OR kind = ?2) AND (?3 IS NULL OR state = ?3)
           AND (?4 IS NULL OR rig = ?4) AND (?5 IS NULL OR lens = ?5) AND (?6 IS NULL OR scan = ?6)
           AND (?8 IS NULL OR owner IS NULL OR owner = ?8)
         ORDER BY seq DESC LIMIT ?7",
    )
    .bind(window.before)
    .bind(filter.kind.map(kind_name))
    .bind(filter.state.map(JobState::as_str))
    .bind(filter.rig.as_ref().map(Name::as_str))
    .bind(filter.lens.as_ref().map(Name::as_str))
    .bind(filter.scan.as_ref().map(Name::as_str))
    .bind(window.rows)
    .bind(filter.owner)
    .fetch(&store.readers);
    let (rows, next_cursor) = window.fill(rows, |row: &JobRow| (row.seq, row.bytes())).await?;
    // megabytes of JSON are no work for a thread that answers requests
    let parsed = tokio::task::spawn_blocking(move || {
        let mut page = Page { items: Vec::new(), next_cursor, skipped: Vec::new() };
        for row in rows {
            let id = row.id;
            match Job::try_from(row) {
                Ok(job) => page.items.push(job),
                Err(error) => page.skipped.push(Skipped::because(id.to_string(), &error)),
            }
        }
        page
    });
    Ok(parsed.await.context("the task that reads rows died")?)
}

/// Keys of the blobs that a row names, also of one that cannot be read; none where its JSON is no JSON.
pub(super) async fn named_keys(store: &SqliteRows, id: Uuid) -> StoreResult<Vec<String>> {
    Ok(sqlx::query_scalar(
        "SELECT key FROM (
             SELECT json_extract(request, '$.upload.key') AS key FROM jobs
             WHERE id = ?1 AND json_valid(request) AND upload_removed = 0
             UNION ALL
             SELECT json_extract(value, '$.key') AS key
             FROM jobs, json_each(iif(json_valid(outcome), outcome, '{}'), '$.artifacts')
             WHERE jobs.id = ?1
         ) WHERE typeof(key) = 'text'",
    )
    .bind(id)
    .fetch_all(&store.readers)
    .await?)
}

pub(super) async fn counts(store: &SqliteRows) -> StoreResult<JobCounts> {
    let rows: Vec<(String, i64)> =
        sqlx::query_as("SELECT state, count(*) FROM jobs GROUP BY state").fetch_all(&store.readers).await?;
    let mut counts = JobCounts::default();
    for (name, count) in rows {
        let place = match state(&name)? {
            JobState::Queued => &mut counts.queued,
            JobState::Running => &mut counts.running,
            JobState::Succeeded => &mut counts.succeeded,
            JobState::Failed => &mut counts.failed,
            JobState::Cancelled => &mut counts.cancelled,
        };
        *place = u64::try_from(count).unwrap_or(0);
    }
    Ok(counts)
}

pub(super) async fn blob_owner(store: &SqliteRows, id: Uuid) -> StoreResult<Option<BlobOwner>> {
    let row: Option<(String, i64, bool)> =
        sqlx::query_as("SELECT state, lease_token, upload_removed FROM jobs WHERE id = ?1")
            .bind(id)
            .fetch_optional(&store.readers)
            .await?;
    let owner = |(name, lease_token, upload_removed): (String, i64, bool)| {
        Ok(BlobOwner { state: state(&name)?, lease_token, upload_removed })
    };
    row.map(owner).transpose()
}

pub(super) fn kind_name(kind: JobKind) -> &'static str {
    match kind {
        JobKind::Stack => "stack",
        JobKind::Calibration => "calibration",
    }
}

fn keep_ms(request: &JobRequest) -> Option<i64> {
    match request {
        JobRequest::Stack(stack) => stack.options.keep_days.map(|days| i64::from(days) * MS_PER_DAY),
        JobRequest::Calibration(_) => None,
    }
}
