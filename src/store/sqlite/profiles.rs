//! Profiles and their revisions.

use std::fmt::Display;

use anyhow::Context;
use futures::Stream;
use sqlx::{SqliteConnection, SqlitePool};

use super::{
    Page, PageRequest, Precondition, ProfileDraft, PutProfile, SqliteRows, StoreError, StoreResult,
    page::Window,
    row::{self, time},
};
use crate::{
    contract::{Name, ProfileSummary, profile::Profile},
    store::{
        Skipped,
        digest::{optics_digest, profile_digest},
        json,
        step::step,
    },
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
    let seq: i64 =
        sqlx::query_scalar("INSERT INTO revisions (rig, lens, revision, body) VALUES (?1, ?2, ?3, ?4) RETURNING seq")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .bind(revision)
            .bind(json::stored::<Profile>("a profile", &profile)?)
            .fetch_one(&mut *connection)
            .await?;
    insert_head(connection, seq, &profile).await?;
    Ok(profile)
}

pub(super) async fn get(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    revision: Option<u32>,
) -> StoreResult<Option<Profile>> {
    let row: Option<(u32, String)> = sqlx::query_as(
        "SELECT revision, body FROM revisions NATURAL JOIN profiles
         WHERE rig = ?1 AND lens = ?2 AND revision = COALESCE(?3, current_revision) AND deleted_at IS NULL",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .bind(revision)
    .fetch_optional(&store.readers)
    .await?;
    row.map(|(revision, body)| read(&called(rig, lens, revision), &body)).transpose()
}

pub(super) async fn of_job(store: &SqliteRows, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>> {
    let body: Option<String> =
        sqlx::query_scalar("SELECT body FROM revisions WHERE rig = ?1 AND lens = ?2 AND revision = ?3")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .bind(revision)
            .fetch_optional(&store.readers)
            .await?;
    body.map(|body| read(&called(rig, lens, revision), &body)).transpose()
}

pub(super) async fn list(
    store: &SqliteRows,
    rig: Option<&Name>,
    lens: Option<&Name>,
    page: &PageRequest,
) -> StoreResult<Page<ProfileSummary>> {
    let window = Window::of(page)?;
    let rows = sqlx::query_as(
        "SELECT seq, rig, lens, revision, COALESCE(head, body) AS json
         FROM profiles NATURAL JOIN revisions LEFT JOIN revision_heads USING (seq)
         WHERE revision = current_revision AND seq < ?1
           AND (?2 IS NULL OR rig = ?2) AND (?3 IS NULL OR lens = ?3)
         ORDER BY seq DESC LIMIT ?4",
    )
    .bind(window.before)
    .bind(rig.map(Name::as_str))
    .bind(lens.map(Name::as_str))
    .bind(window.rows)
    .fetch(&store.readers);
    parsed(&window, rows, |row: RevisionRow| json::read(row.called(), &row.json)).await
}

pub(super) async fn revisions(
    store: &SqliteRows,
    rig: &Name,
    lens: &Name,
    page: &PageRequest,
) -> StoreResult<Page<ProfileSummary>> {
    let window = Window::of(page)?;
    let rows = sqlx::query_as(
        "SELECT seq, rig, lens, revision, COALESCE(head, body) AS json
         FROM revisions LEFT JOIN revision_heads USING (seq)
         WHERE rig = ?1 AND lens = ?2 AND deleted_at IS NULL AND seq < ?3
         ORDER BY seq DESC LIMIT ?4",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .bind(window.before)
    .bind(window.rows)
    .fetch(&store.readers);
    parsed(&window, rows, |row: RevisionRow| json::read(row.called(), &row.json)).await
}

pub(super) async fn stored(store: &SqliteRows, page: &PageRequest) -> StoreResult<Page<Profile>> {
    let window = Window::of(page)?;
    let rows = sqlx::query_as(
        "SELECT seq, rig, lens, revision, body AS json FROM revisions WHERE seq < ?1 ORDER BY seq DESC LIMIT ?2",
    )
    .bind(window.before)
    .bind(window.rows)
    .fetch(&store.readers);
    parsed(&window, rows, |row: RevisionRow| read(&row.called(), &row.json)).await
}

pub(super) async fn keys(store: &SqliteRows, limit: u32) -> StoreResult<Vec<(Name, Name)>> {
    let rows: Vec<(String, String)> =
        sqlx::query_as("SELECT rig, lens FROM profiles WHERE current_revision IS NOT NULL ORDER BY rig, lens LIMIT ?1")
            .bind(limit)
            .fetch_all(&store.readers)
            .await?;
    rows.into_iter().map(|(rig, lens)| Ok((row::name(rig)?, row::name(lens)?))).collect()
}

/// Gives a head to each revision of before there were heads. What cannot be read gets none.
pub(super) async fn fill_heads(writer: &SqlitePool) -> StoreResult<()> {
    let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
    let mut after = 0;
    loop {
        let row: Option<RevisionRow> = sqlx::query_as(
            "SELECT seq, rig, lens, revision, body AS json FROM revisions
             WHERE seq = (SELECT seq FROM revisions LEFT JOIN revision_heads USING (seq)
                          WHERE head IS NULL AND seq > ?1 ORDER BY seq LIMIT 1)",
        )
        .bind(after)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(row) = row else { break };
        after = row.seq;
        match read(&row.called(), &row.json) {
            Ok(profile) => insert_head(&mut tx, row.seq, &profile).await?,
            Err(error) => tracing::error!(row = row.called(), ?error, "a revision cannot be read"),
        }
    }
    step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot write the summaries of profiles".into()))?;
    tx.commit().await?;
    Ok(())
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

/// What lists read of a row of `revisions`.
#[derive(sqlx::FromRow)]
struct RevisionRow {
    seq: i64,
    rig: String,
    lens: String,
    revision: u32,
    json: String,
}

impl RevisionRow {
    fn called(&self) -> String {
        called(&self.rig, &self.lens, self.revision)
    }
}

/// What a revision is called where it cannot be read.
fn called(rig: impl Display, lens: impl Display, revision: u32) -> String {
    format!("{rig}/{lens}?revision={revision}")
}

/// Reads a page of rows; those that cannot be read are left out and named.
async fn parsed<T: Send + 'static>(
    window: &Window,
    rows: impl Stream<Item = Result<RevisionRow, sqlx::Error>> + Unpin,
    read: impl Fn(RevisionRow) -> StoreResult<T> + Send + 'static,
) -> StoreResult<Page<T>> {
    let (rows, next_cursor) = window.fill(rows, |row: &RevisionRow| (row.seq, row.json.len())).await?;
    let parsed = tokio::task::spawn_blocking(move || {
        let mut page = Page { items: Vec::new(), next_cursor, skipped: Vec::new() };
        for row in rows {
            let id = row.called();
            match read(row) {
                Ok(item) => page.items.push(item),
                Err(error) => page.skipped.push(Skipped::because(id, &error)),
            }
        }
        page
    });
    Ok(parsed.await.context("the task that reads rows died")?)
}

/// Stores what lists show of a revision.
async fn insert_head(connection: &mut SqliteConnection, seq: i64, profile: &Profile) -> StoreResult<()> {
    let head = json::stored::<ProfileSummary>("the summary of a profile", &ProfileSummary::from(profile))?;
    sqlx::query("INSERT INTO revision_heads (seq, head) VALUES (?1, ?2)")
        .bind(seq)
        .bind(head)
        .execute(connection)
        .await?;
    Ok(())
}

/// The profile that a body holds. One that was stored before profiles had a digest of their optics gets it here.
fn read(row: &str, body: &str) -> StoreResult<Profile> {
    let mut profile: Profile = json::read(row, body)?;
    if profile.optics_digest.is_empty() {
        profile.optics_digest = optics_digest(&profile.input);
    }
    Ok(profile)
}
