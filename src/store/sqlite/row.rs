//! Conversions between columns and types of the contract.

use anyhow::{Context, anyhow};
use jiff::Timestamp;
use uuid::Uuid;

use super::{StoreError, StoreResult};
use crate::{
    contract::{JobKind, JobState, Name, Progress},
    store::{Job, json},
};

/// The columns of `jobs` that a [`Job`] is read from.
#[derive(sqlx::FromRow)]
pub(super) struct JobRow {
    pub(super) seq: i64,
    pub(super) id: Uuid,
    rig: String,
    lens: String,
    request: String,
    state: String,
    stage: String,
    completed: i64,
    total: i64,
    fraction: f64,
    attempt: i64,
    pub(super) lease_token: i64,
    version: i64,
    created_at: i64,
    started_at: Option<i64>,
    finished_at: Option<i64>,
    cancel_requested: bool,
    error: Option<String>,
    warnings: String,
    outcome: Option<String>,
    upload_removed: bool,
    pub(super) fingerprint: Option<String>,
}

impl JobRow {
    /// Bytes of the columns that grow with the number of slices.
    pub(super) fn bytes(&self) -> usize {
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
            outcome: row.outcome.as_deref().map(|text| json::read(&label, text)).transpose()?,
        })
    }
}

pub(super) fn name(text: String) -> StoreResult<Name> {
    Ok(Name::new(text).context("a row contains an invalid name")?)
}

pub(super) fn time(ms: i64) -> StoreResult<Timestamp> {
    Ok(Timestamp::from_millisecond(ms).context("a row contains a time out of range")?)
}

pub(super) fn kind(text: &str) -> StoreResult<JobKind> {
    match text {
        "stack" => Ok(JobKind::Stack),
        "calibration" => Ok(JobKind::Calibration),
        _ => Err(anyhow!("a row contains the unknown kind '{text}'").into()),
    }
}

pub(super) fn state(text: &str) -> StoreResult<JobState> {
    let all = [JobState::Queued, JobState::Running, JobState::Succeeded, JobState::Failed, JobState::Cancelled];
    let known = all.into_iter().find(|state| state.as_str() == text);
    Ok(known.ok_or_else(|| anyhow!("a row contains the unknown state '{text}'"))?)
}

/// A number of bytes as SQLite stores it.
pub(super) fn signed(bytes: u64) -> i64 {
    i64::try_from(bytes).unwrap_or(i64::MAX)
}

/// A number of bytes, or a count, as SQLite returns it.
pub(super) fn unsigned(number: i64) -> u64 {
    u64::try_from(number).unwrap_or(0)
}
