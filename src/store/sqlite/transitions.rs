//! State transitions that end a job. Each reads and writes within one transaction that holds the write lock, so exactly
//! one of a concurrent cancellation and finish wins.

use sqlx::SqliteConnection;
use uuid::Uuid;

use super::{
    SqliteMetadata, StoreResult, profiles,
    row::{self, signed},
};
use crate::{
    contract::{Code, Fault, JobState, outcome::JobOutcome},
    store::{Finish, json},
};
use pinstack_science::types::Warning;

/// The final values of the row of a job.
#[derive(Default)]
pub(super) struct Transition<'a> {
    pub(super) state: &'static str,
    pub(super) error: Option<&'a Fault>,
    pub(super) warnings: Option<&'a [Warning]>,
    pub(super) outcome: Option<JobOutcome>,
}

/// Ends a running job. An outcome that cannot be stored (a number that is not finite) fails the job.
pub(super) async fn finish(store: &SqliteMetadata, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
    match write_finish(store, id, lease_token, finish).await {
        Err(error) if json::is_not_storable(&error) => {
            tracing::error!(job = %id, ?error, "the result of a job cannot be stored");
            let detail = "the result of this job contains a number that cannot be stored; this is a bug of the service; its \
                          log has the details under the id of the job";
            write_finish(store, id, lease_token, &Finish::Failed(Fault::new(Code::Internal, detail))).await
        }
        written => written,
    }
}

async fn write_finish(store: &SqliteMetadata, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
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
            _ if cancel_requested => Transition { state: "cancelled", ..Transition::default() },
            Finish::Cancelled => Transition { state: "cancelled", ..Transition::default() },
            Finish::Failed(fault) => Transition { state: "failed", error: Some(fault), ..Transition::default() },
            Finish::Succeeded { outcome, warnings, profile } => {
                let mut outcome = (**outcome).clone();
                if let Some(draft) = profile {
                    let (rig, lens) = (row::name(rig)?, row::name(lens)?);
                    let stored = profiles::insert(&mut tx, &rig, &lens, draft, now).await?;
                    if let JobOutcome::Calibration(calibration) = &mut outcome {
                        calibration.profile_revision = Some(stored.revision);
                        calibration.profile_digest = Some(stored.digest);
                        calibration.profile_optics_digest = Some(stored.optics_digest);
                    }
                }
                Transition {
                    state: "succeeded",
                    warnings: Some(warnings),
                    outcome: Some(outcome),
                    ..Transition::default()
                }
            }
        };
        apply(&mut tx, id, now, &end).await?;
    }
    store.commit(tx, "rows.finish").await?;
    store.changed(id);
    Ok(true)
}

/// Writes the end of a job within a transaction that the caller commits.
pub(super) async fn apply(
    connection: &mut SqliteConnection,
    id: Uuid,
    now: i64,
    end: &Transition<'_>,
) -> StoreResult<()> {
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

/// The state of a job, and whether a worker holds a lease on it. `None` for a job that is deleted.
pub(super) async fn state_and_lease(
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
