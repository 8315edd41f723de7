//! State transitions that end a job. Each reads and writes within one transaction that locks the row of the job, so
//! exactly one of a concurrent cancellation and finish wins.

use uuid::Uuid;

use super::{
    engine::{Connection, Metadata, dialect},
    profiles, search,
};
use crate::{
    contract::JobState,
    store::{
        Finish, StoreResult, json,
        rows::{
            name, state,
            transaction::Notice,
            transition::{Transition, not_storable},
        },
    },
};

/// Ends a running job. An outcome that cannot be stored (a number that is not finite) fails the job.
pub(super) async fn finish(store: &Metadata, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
    match write_finish(store, id, lease_token, finish).await {
        Err(error) if json::is_not_storable(&error) => {
            write_finish(store, id, lease_token, &not_storable(id, &error)).await
        }
        written => written,
    }
}

async fn write_finish(store: &Metadata, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
    let mut tx = store.write().await?;
    let now = store.now(&mut *tx).await?;
    let held: Option<(bool, bool, String, String)> = sqlx::query_as(concat!(
        "SELECT cancel_requested, delete_requested, rig, lens FROM jobs
         WHERE id = $1 AND lease_token = $2 AND state = 'running'",
        dialect!(FOR UPDATE)
    ))
    .bind(id)
    .bind(lease_token)
    .fetch_optional(&mut *tx)
    .await?;
    let Some((cancel_requested, delete_requested, rig, lens)) = held else { return Ok(false) };
    if delete_requested {
        sqlx::query("DELETE FROM jobs WHERE id = $1").bind(id).execute(&mut *tx).await?;
    } else {
        let profile = match finish {
            Finish::Succeeded { profile: Some(draft), .. } if !cancel_requested => {
                Some(profiles::insert(&mut tx, &name(rig)?, &name(lens)?, draft, now).await?)
            }
            _ => None,
        };
        let end = Transition::of(finish, cancel_requested, profile.as_ref());
        apply(&mut tx, id, now, &end).await?;
    }
    store.commit(tx, "rows.finish", Notice::Changes(&[id])).await?;
    Ok(true)
}

/// Writes the end of a job within a transaction that the caller commits.
pub(super) async fn apply(connection: &mut Connection, id: Uuid, now: i64, end: &Transition<'_>) -> StoreResult<()> {
    sqlx::query(
        "UPDATE jobs
         SET state = $2, finished_at = $3, lease_until = NULL, version = version + 1, result_bytes = $7,
             error = $4, warnings = COALESCE($5, warnings), outcome = $6,
             stage = CASE WHEN $2 = 'succeeded' THEN 'done' ELSE stage END,
             completed = CASE WHEN $2 = 'succeeded' THEN 1 ELSE completed END,
             total = CASE WHEN $2 = 'succeeded' THEN 1 ELSE total END,
             fraction = CASE WHEN $2 = 'succeeded' THEN 1.0 ELSE fraction END
         WHERE id = $1",
    )
    .bind(id)
    .bind(end.state)
    .bind(now)
    .bind(end.error_json()?)
    .bind(end.warnings_json()?)
    .bind(end.outcome_json()?)
    .bind(end.result_bytes())
    .execute(&mut *connection)
    .await?;
    if let Some(term) = end.term() {
        search::index_end(connection, id, &term).await?;
    }
    Ok(())
}

/// The state of a job, and whether a worker holds a lease on it. `None` for a job that is deleted.
pub(super) async fn state_and_lease(
    connection: &mut Connection,
    id: Uuid,
    now: i64,
) -> StoreResult<Option<(JobState, bool)>> {
    let row: Option<(String, Option<i64>)> = sqlx::query_as(concat!(
        "SELECT state, lease_until FROM jobs WHERE id = $1 AND NOT delete_requested",
        dialect!(FOR UPDATE)
    ))
    .bind(id)
    .fetch_optional(connection)
    .await?;
    row.map(|(name, until)| Ok((state(&name)?, until.is_some_and(|until| until > now)))).transpose()
}
