//! What the database engines share: the rows as they are read, their conversion to the types of the store, pages of
//! lists, and what needs no type of an engine. The statements are in `store/sql`.
//!
//! An engine stores numbers as 64-bit integers, times as milliseconds since 1970 (UTC), and JSON as text.

pub(in crate::store) mod clock_gaps;
mod error;
pub(in crate::store) mod expired_leases;
mod from_row;
pub(in crate::store) mod note;
pub(in crate::store) mod page;
pub(in crate::store) mod profile;
pub(in crate::store) mod scan;
pub(in crate::store) mod schema;
pub(in crate::store) mod token;
pub(in crate::store) mod totals;
pub(in crate::store) mod transaction;
pub(in crate::store) mod transfer;
pub(in crate::store) mod transition;
pub(in crate::store) mod turn;
pub(in crate::store) mod upload;

use anyhow::{Context, anyhow};
use from_row::from_row;
use jiff::Timestamp;
use uuid::Uuid;

use super::{Job, JobCounts, Page, Skipped, StoreError, StoreResult, json};
use crate::contract::{JobKind, JobState, Name, Progress, request::JobRequest};

/// Milliseconds of a day.
const MS_PER_DAY: i64 = 24 * 60 * 60 * 1000;

/// The columns of `jobs` that a [`Job`] is read from.
pub(in crate::store) struct JobRow {
    pub(in crate::store) seq: i64,
    pub(in crate::store) id: Uuid,
    rig: String,
    lens: String,
    request: String,
    state: String,
    stage: String,
    completed: i64,
    total: i64,
    fraction: f64,
    attempt: i64,
    pub(in crate::store) lease_token: i64,
    version: i64,
    created_at: i64,
    started_at: Option<i64>,
    finished_at: Option<i64>,
    cancel_requested: bool,
    error: Option<String>,
    warnings: String,
    outcome: Option<String>,
    upload_removed: bool,
    trace: Option<String>,
    pub(in crate::store) fingerprint: Option<String>,
}

from_row! { JobRow {
    seq, id, rig, lens, request, state, stage, completed, total, fraction, attempt, lease_token, version,
    created_at, started_at, finished_at, cancel_requested, error, warnings, outcome, upload_removed, trace,
    fingerprint
} }

impl JobRow {
    /// Bytes of the columns that grow with the number of slices.
    pub(in crate::store) fn bytes(&self) -> usize {
        let optional = |text: &Option<String>| text.as_ref().map_or(0, String::len);
        self.request.len() + self.warnings.len() + optional(&self.error) + optional(&self.outcome)
    }
}

impl TryFrom<JobRow> for Job {
    type Error = StoreError;

    fn try_from(row: JobRow) -> StoreResult<Self> {
        let label = format!("the row of job {}", row.id);
        Ok(Self {
            id: row.id,
            rig: name(row.rig)?,
            lens: name(row.lens)?,
            request: json::read(&label, &row.request)?,
            state: state(&row.state)?,
            progress: Progress {
                stage: row.stage,
                completed: u32::try_from(row.completed).unwrap_or(u32::MAX),
                total: u32::try_from(row.total).unwrap_or(u32::MAX),
                fraction: row.fraction,
            },
            attempt: u32::try_from(row.attempt).unwrap_or(u32::MAX),
            lease_token: row.lease_token,
            version: row.version,
            created_at: time(row.created_at)?,
            started_at: row.started_at.map(time).transpose()?,
            finished_at: row.finished_at.map(time).transpose()?,
            cancel_requested: row.cancel_requested,
            error: row.error.as_deref().map(|text| json::read(&label, text)).transpose()?,
            warnings: json::read(&label, &row.warnings)?,
            upload_removed: row.upload_removed,
            trace: row.trace,
            outcome: row.outcome.as_deref().map(|text| json::read(&label, text)).transpose()?,
        })
    }
}

pub(in crate::store) fn name(text: String) -> StoreResult<Name> {
    Ok(Name::new(text).context("a row contains an invalid name")?)
}

pub(in crate::store) fn time(ms: i64) -> StoreResult<Timestamp> {
    Ok(Timestamp::from_millisecond(ms).context("a row contains a time out of range")?)
}

pub(in crate::store) fn kind(text: &str) -> StoreResult<JobKind> {
    let known = JobKind::ALL.into_iter().find(|kind| kind.as_str() == text);
    Ok(known.ok_or_else(|| anyhow!("a row contains the unknown kind '{text}'"))?)
}

pub(in crate::store) fn state(text: &str) -> StoreResult<JobState> {
    let known = JobState::ALL.into_iter().find(|state| state.as_str() == text);
    Ok(known.ok_or_else(|| anyhow!("a row contains the unknown state '{text}'"))?)
}

/// A number of bytes as a column stores it.
pub(in crate::store) fn signed(bytes: u64) -> i64 {
    i64::try_from(bytes).unwrap_or(i64::MAX)
}

/// A number of bytes, or a count, as a column returns it.
pub(in crate::store) fn unsigned(number: i64) -> u64 {
    u64::try_from(number).unwrap_or(0)
}

/// How long a job is kept after its end, if its request says so.
pub(in crate::store) fn keep_ms(request: &JobRequest) -> Option<i64> {
    match request {
        JobRequest::Stack(stack) => stack.options.keep_days.map(|days| i64::from(days) * MS_PER_DAY),
        JobRequest::Calibration(_) | JobRequest::Reconstruction(_) => None,
    }
}

/// A page of jobs. Rows that cannot be read are listed as skipped.
pub(in crate::store) async fn listed(rows: Vec<JobRow>, next_cursor: Option<String>) -> StoreResult<Page<Job>> {
    // parsing megabytes of JSON would block a thread that serves requests
    let parsed = tokio::task::spawn_blocking(move || {
        Page::of_rows(rows, next_cursor, |row| {
            let id = row.id;
            Job::try_from(row).map_err(|error| Skipped::unreadable(id.to_string(), &error))
        })
    });
    Ok(parsed.await.context("the task that parses rows panicked")?)
}

/// Number of jobs by state, from rows of names and counts.
pub(in crate::store) fn counts(rows: Vec<(String, i64)>) -> StoreResult<JobCounts> {
    let mut counts = JobCounts::default();
    for (name, count) in rows {
        let place = match state(&name)? {
            JobState::Queued => &mut counts.queued,
            JobState::Running => &mut counts.running,
            JobState::Succeeded => &mut counts.succeeded,
            JobState::Failed => &mut counts.failed,
            JobState::Cancelled => &mut counts.cancelled,
        };
        *place = unsigned(count);
    }
    Ok(counts)
}

/// Keys of the blobs that a row refers to, as far as its JSON can be read.
pub(in crate::store) fn blob_keys(request: &str, outcome: Option<&str>, upload_removed: bool) -> Vec<String> {
    let parse = |text: &str| serde_json::from_str(text).unwrap_or(serde_json::Value::Null);
    let key = |value: &serde_json::Value| value.as_str().map(str::to_owned);
    let upload = (!upload_removed).then(|| key(&parse(request)["upload"]["key"])).flatten();
    let outcome = outcome.map(parse).unwrap_or_default();
    let artifacts = outcome["artifacts"].as_array().map(Vec::as_slice).unwrap_or_default();
    upload.into_iter().chain(artifacts.iter().filter_map(|artifact| key(&artifact["key"]))).collect()
}
