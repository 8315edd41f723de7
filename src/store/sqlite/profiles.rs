//! Profiles and their revisions.

use sqlx::SqliteConnection;

use super::{
    Page, PageRequest, Precondition, ProfileDraft, PutProfile, SqliteRows, StoreResult, page::Window, row::time,
};
use crate::{
    model::{Name, profile::Profile},
    store::digest::{optics_digest, profile_digest},
};

pub(super) async fn put(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    draft: &ProfileDraft,
    condition: Precondition,
) -> StoreResult<PutProfile> {
    let mut tx = store.write().await?;
    let current = current_revision(&mut tx, rig, lens).await?;
    if !condition.holds(current) {
        return Ok(PutProfile::PreconditionFailed(current));
    }
    let profile = insert(&mut tx, rig, lens, draft, store.clock.now_ms()).await?;
    store.commit(tx, "rows.put_profile").await?;
    Ok(match current {
        None => PutProfile::Created(profile),
        Some(_) => PutProfile::Updated(profile),
    })
}

/// Stores the next revision inside a transaction of the caller.
pub(super) async fn insert(
    connection: &mut SqliteConnection,
    rig: &Name,
    lens: &Name,
    draft: &ProfileDraft,
    now_ms: i64,
) -> StoreResult<Profile> {
    let revision: u32 = sqlx::query_scalar(
        "INSERT INTO profiles (rig, lens, last_revision, current_revision) VALUES (?1, ?2, 1, 1)
         ON CONFLICT (rig, lens) DO UPDATE
         SET last_revision = last_revision + 1, current_revision = last_revision + 1
         RETURNING current_revision",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .fetch_one(&mut *connection)
    .await?;
    let profile = Profile {
        rig: rig.clone(),
        lens: lens.clone(),
        revision,
        digest: profile_digest(&draft.input),
        optics_digest: optics_digest(&draft.input),
        created_at: time(now_ms)?,
        source: draft.source,
        calibration_id: draft.calibration_id,
        origin: draft.origin.clone(),
        model: draft.model,
        warnings: draft.warnings.clone(),
        principal_distance_px: draft.input.principal_distance_px(),
        slice_count: u32::try_from(draft.input.homographies.len()).unwrap_or(u32::MAX),
        input: draft.input.clone(),
        slices: draft.slices.clone(),
    };
    sqlx::query("INSERT INTO revisions (rig, lens, revision, body) VALUES (?1, ?2, ?3, ?4)")
        .bind(rig.as_str())
        .bind(lens.as_str())
        .bind(revision)
        .bind(serde_json::to_string(&profile)?)
        .execute(&mut *connection)
        .await?;
    Ok(profile)
}

pub(super) async fn get(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    revision: Option<u32>,
) -> StoreResult<Option<Profile>> {
    let body: Option<String> = sqlx::query_scalar(
        "SELECT body FROM revisions NATURAL JOIN profiles
         WHERE rig = ?1 AND lens = ?2 AND revision = COALESCE(?3, current_revision) AND deleted_at IS NULL",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .bind(revision)
    .fetch_optional(&store.readers)
    .await?;
    body.as_deref().map(read).transpose()
}

pub(super) async fn of_job(store: &SqliteRows, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>> {
    let body: Option<String> =
        sqlx::query_scalar("SELECT body FROM revisions WHERE rig = ?1 AND lens = ?2 AND revision = ?3")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .bind(revision)
            .fetch_optional(&store.readers)
            .await?;
    body.as_deref().map(read).transpose()
}

pub(super) async fn list(
    store: &SqliteRows,
    rig: Option<&Name>,
    lens: Option<&Name>,
    page: &PageRequest,
) -> StoreResult<Page<Profile>> {
    let window = Window::of(page)?;
    let rows: Vec<(i64, String)> = sqlx::query_as(
        "SELECT seq, body FROM revisions NATURAL JOIN profiles
         WHERE revision = current_revision AND seq < ?1
           AND (?2 IS NULL OR rig = ?2) AND (?3 IS NULL OR lens = ?3)
         ORDER BY seq DESC LIMIT ?4",
    )
    .bind(window.before)
    .bind(rig.map(Name::as_str))
    .bind(lens.map(Name::as_str))
    .bind(window.rows)
    .fetch_all(&store.readers)
    .await?;
    parsed(&window, rows)
}

pub(super) async fn revisions(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    page: &PageRequest,
) -> StoreResult<Page<Profile>> {
    let window = Window::of(page)?;
    let rows: Vec<(i64, String)> = sqlx::query_as(
        "SELECT seq, body FROM revisions
         WHERE rig = ?1 AND lens = ?2 AND deleted_at IS NULL AND seq < ?3
         ORDER BY seq DESC LIMIT ?4",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .bind(window.before)
    .bind(window.rows)
    .fetch_all(&store.readers)
    .await?;
    parsed(&window, rows)
}

pub(super) async fn delete(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    condition: Precondition,
) -> StoreResult<Result<bool, Option<u32>>> {
    let mut tx = store.write().await?;
    let current = current_revision(&mut tx, rig, lens).await?;
    if !condition.holds(current) {
        return Ok(Err(current));
    }
    if current.is_none() {
        return Ok(Ok(false));
    }
    sqlx::query("UPDATE profiles SET current_revision = NULL WHERE rig = ?1 AND lens = ?2")
        .bind(rig.as_str())
        .bind(lens.as_str())
        .execute(&mut *tx)
        .await?;
    sqlx::query("UPDATE revisions SET deleted_at = ?3 WHERE rig = ?1 AND lens = ?2 AND deleted_at IS NULL")
        .bind(rig.as_str())
        .bind(lens.as_str())
        .bind(store.clock.now_ms())
        .execute(&mut *tx)
        .await?;
    store.commit(tx, "rows.delete_profile").await?;
    Ok(Ok(true))
}

async fn current_revision(connection: &mut SqliteConnection, rig: &Name, lens: &Name) -> StoreResult<Option<u32>> {
    let current: Option<Option<u32>> =
        sqlx::query_scalar("SELECT current_revision FROM profiles WHERE rig = ?1 AND lens = ?2")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .fetch_optional(connection)
            .await?;
    Ok(current.flatten())
}

fn parsed(window: &Window, rows: Vec<(i64, String)>) -> StoreResult<Page<Profile>> {
    let rows: StoreResult<Vec<(i64, Profile)>> = rows.into_iter().map(|(seq, body)| Ok((seq, read(&body)?))).collect();
    Ok(window.page(rows?))
}

/// The profile that a body holds. One that was stored before profiles had a digest of their optics gets it here.
fn read(body: &str) -> StoreResult<Profile> {
    let mut profile: Profile = serde_json::from_str(body)?;
    if profile.optics_digest.is_empty() {
        profile.optics_digest = optics_digest(&profile.input);
    }
    Ok(profile)
}
