//! How jobs end: finished by their worker, cancelled, deleted. Each write looks and acts inside one
//! transaction that holds the write lock, so a cancel and a finish that meet have exactly one winner.

use sqlx::SqliteConnection;
use uuid::Uuid;

use super::{CancelRequest, Finish, SqliteRows, StoreResult, profiles, row, uploads::signed};
use crate::{
    contract::{Code, Fault, JobState, outcome::JobOutcome},
    store::json,
};
use pinstack_science::types::Warning;

/// What a row becomes at its end.
#[derive(Default)]
struct End<'a> {
    state: &'static str,
    error: Option<&'a Fault>,
    warnings: Option<&'a [Warning]>,
    outcome: Option<JobOutcome>,
}

pub(super) async fn finish(store: &SqliteRows, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
    match write_finish(store, id, lease_token, finish).await {
        Err(error) if json::is_not_storable(&error) => {
            tracing::error!(job = %id, ?error, "the result of a job cannot be stored");
            let detail = "the result of this job has a number that cannot be stored; this is a bug of the service, and its \
                          log has the details under the job's id";
            write_finish(store, id, lease_token, &Finish::Failed(Fault::new(Code::Internal, detail))).await
        }
        written => written,
    }
}

async fn write_finish(store: &SqliteRows, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
    let now = store.clock.now_ms();
    let mut tx = store.write().await?;
    let held: Option<(bool, bool, String, String)> = sqlx::query_as(
        "SELECT cancel_requested, delete_requested, rig, lens FROM jobs
         WHERE id = ?1 AND lease_token = ?2 AND state = 'running'",
    )
    .bind(id)
    .bind(lease_token)
    .fetch_optional(&mut *tx)
    .await?;
    let Some((cancel_requested, delete_requested, rig, lens)) = held else { return Ok(false) };
    if delete_requested {
        sqlx::query("DELETE FROM jobs WHERE id = ?1").bind(id).execute(&mut *tx).await?;
    } else {
        let end = match finish {
            _ if cancel_requested => End { state: "cancelled", ..End::default() },
            Finish::Cancelled => End { state: "cancelled", ..End::default() },
            Finish::Failed(fault) => End { state: "failed", error: Some(fault), ..End::default() },
            Finish::Succeeded { outcome, warnings, profile } => {
                let mut outcome = (**outcome).clone();
                if let Some(draft) = profile {
                    let (rig, lens) = (row::name(rig)?, row::name(lens)?);
                    let stored = profiles::insert(&mut tx, &rig, &lens, draft, now).await?;
                    if let JobOutcome::Calibration(calibration) = &mut outcome {
                        calibration.profile_revision = stored.revision;
                        calibration.profile_digest = stored.digest;
                        calibration.profile_optics_digest = Some(stored.optics_digest);
                    }
                }
                End { state: "succeeded", warnings: Some(warnings), outcome: Some(outcome), ..End::default() }
            }
        };
        write_end(&mut tx, id, now, &end).await?;
    }
    store.commit(tx, "rows.finish").await?;
    store.changed(id);
    Ok(true)
}

async fn write_end(connection: &mut SqliteConnection, id: Uuid, now: i64, end: &End<'_>) -> StoreResult<()> {
    sqlx::query(
        "UPDATE jobs
         SET state = ?2, finished_at = ?3, lease_until = NULL, version = version + 1, result_bytes = ?7,
             error = ?4, warnings = COALESCE(?5, warnings), outcome = ?6,
             stage = iif(?2 = 'succeeded', 'done', stage),
             completed = iif(?2 = 'succeeded', 1, completed),
             total = iif(?2 = 'succeeded', 1, total),
             fraction = iif(?2 = 'succeeded', 1.0, fraction)
         WHERE id = ?1",
    )
    .bind(id)
    .bind(end.state)
    .bind(now)
    .bind(end.error.map(|fault| json::stored::<Fault>("the error of a job", fault)).transpose()?)
    .bind(end.warnings.map(|all| json::stored::<Vec<Warning>>("the warnings of a job", all)).transpose()?)
    .bind(end.outcome.as_ref().map(|made| json::stored::<JobOutcome>("the result of a job", made)).transpose()?)
    .bind(signed(end.outcome.as_ref().map_or(0, JobOutcome::bytes)))
    .execute(connection)
    .await?;
    Ok(())
}

pub(super) async fn cancel(store: &SqliteRows, id: Uuid) -> StoreResult<Option<CancelRequest>> {
    let now = store.clock.now_ms();
    let mut tx = store.write().await?;
    let Some((state, held)) = state_and_lease(&mut tx, id, now).await? else { return Ok(None) };
    let answer = match state {
        JobState::Succeeded | JobState::Failed | JobState::Cancelled => {
            return Ok(Some(CancelRequest::AlreadyEnded(state)));
        }
        JobState::Running if held => {
            sqlx::query(
                "UPDATE jobs SET cancel_requested = 1, version = version + 1 WHERE id = ?1 AND cancel_requested = 0",
            )
            .bind(id)
            .execute(&mut *tx)
            .await?;
            CancelRequest::Requested
        }
        // nobody works on it: it waits, or its worker is gone
        JobState::Queued | JobState::Running => {
            write_end(&mut tx, id, now, &End { state: "cancelled", ..End::default() }).await?;
            sqlx::query("UPDATE jobs SET cancel_requested = 1 WHERE id = ?1").bind(id).execute(&mut *tx).await?;
            CancelRequest::Cancelled
        }
    };
    store.commit(tx, "rows.cancel").await?;
    store.changed(id);
    Ok(Some(answer))
}

pub(super) async fn delete(store: &SqliteRows, id: Uuid) -> StoreResult<bool> {
    let mut tx = store.write().await?;
    let Some((state, held)) = state_and_lease(&mut tx, id, store.clock.now_ms()).await? else { return Ok(false) };
    let sql = if state == JobState::Running && held {
        // its idempotency key is free again at once
        "UPDATE jobs SET cancel_requested = 1, delete_requested = 1, idempotency_key = NULL, version = version + 1
         WHERE id = ?1"
    } else {
        "DELETE FROM jobs WHERE id = ?1"
    };
    sqlx::query(sql).bind(id).execute(&mut *tx).await?;
    store.commit(tx, "rows.delete").await?;
    store.changed(id);
    Ok(true)
}

/// The state of a job that clients can see, and whether a worker holds a lease on it.
async fn state_and_lease(
    connection: &mut SqliteConnection,
    id: Uuid,
    now: i64,
) -> StoreResult<Option<(JobState, bool)>> {
    let row: Option<(String, Option<i64>)> =
        sqlx::query_as("SELECT state, lease_until FROM jobs WHERE id = ?1 AND delete_requested = 0")
            .bind(id)
            .fetch_optional(connection)
            .await?;
    row.map(|(name, until)| Ok((row::state(&name)?, until.is_some_and(|until| until > now)))).transpose()
}
