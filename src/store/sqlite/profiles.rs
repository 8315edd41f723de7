//! Profiles and their revisions. A revision is stored twice: as a whole (`revisions.body`), and as the summary that
//! lists show (`revision_heads.head`), so that a list does not read megabytes of homographies.

use async_trait::async_trait;
use sqlx::{SqliteConnection, SqlitePool};

use super::{SqliteMetadata, StoreError, StoreResult};
use crate::{
    contract::{Name, ProfileSummary, profile::Profile},
    store::{
        Page, PageRequest, Precondition, ProfileDraft, ProfileStore, PutProfile,
        failpoint::step,
        json,
        rows::{
            name,
            page::Window,
            profile::{RevisionRow, label, new_revision, parsed, read, stored, summary},
        },
    },
};

#[async_trait]
impl ProfileStore for SqliteMetadata {
    async fn put_profile(
        &self,
        rig: &Name,
        lens: &Name,
        draft: &ProfileDraft,
        condition: Precondition,
    ) -> StoreResult<PutProfile> {
        let mut tx = self.write().await?;
        let current = current_revision(&mut tx, rig, lens).await?;
        if !condition.holds(current) {
            return Ok(PutProfile::PreconditionFailed(current));
        }
        let profile = insert(&mut tx, rig, lens, draft, self.clock.now_ms()).await?;
        self.commit(tx, "rows.put_profile").await?;
        Ok(match current {
            None => PutProfile::Created(profile),
            Some(_) => PutProfile::Updated(profile),
        })
    }

    async fn profile(&self, rig: &Name, lens: &Name, revision: Option<u32>) -> StoreResult<Option<Profile>> {
        let row: Option<(u32, String)> = sqlx::query_as(
            "SELECT revision, body FROM revisions NATURAL JOIN profiles
             WHERE rig = ?1 AND lens = ?2 AND revision = COALESCE(?3, current_revision) AND deleted_at IS NULL",
        )
        .bind(rig.as_str())
        .bind(lens.as_str())
        .bind(revision)
        .fetch_optional(&self.readers)
        .await?;
        row.map(|(revision, body)| read(&label(rig, lens, revision), &body)).transpose()
    }

    async fn profile_of_job(&self, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>> {
        let body: Option<String> =
            sqlx::query_scalar("SELECT body FROM revisions WHERE rig = ?1 AND lens = ?2 AND revision = ?3")
                .bind(rig.as_str())
                .bind(lens.as_str())
                .bind(revision)
                .fetch_optional(&self.readers)
                .await?;
        body.map(|body| read(&label(rig, lens, revision), &body)).transpose()
    }

    async fn profiles(
        &self,
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
        .fetch(&self.readers);
        parsed(&window, rows, |row: RevisionRow| json::read(row.label(), &row.json)).await
    }

    async fn revisions(&self, rig: &Name, lens: &Name, page: &PageRequest) -> StoreResult<Page<ProfileSummary>> {
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
        .fetch(&self.readers);
        parsed(&window, rows, |row: RevisionRow| json::read(row.label(), &row.json)).await
    }

    async fn all_revisions(&self, page: &PageRequest) -> StoreResult<Page<Profile>> {
        let window = Window::of(page)?;
        let rows = sqlx::query_as(
            "SELECT seq, rig, lens, revision, body AS json FROM revisions WHERE seq < ?1 ORDER BY seq DESC LIMIT ?2",
        )
        .bind(window.before)
        .bind(window.rows)
        .fetch(&self.readers);
        parsed(&window, rows, |row: RevisionRow| read(&row.label(), &row.json)).await
    }

    async fn profile_keys(&self, limit: u32) -> StoreResult<Vec<(Name, Name)>> {
        let rows: Vec<(String, String)> = sqlx::query_as(
            "SELECT rig, lens FROM profiles WHERE current_revision IS NOT NULL ORDER BY rig, lens LIMIT ?1",
        )
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.into_iter().map(|(rig, lens)| Ok((name(rig)?, name(lens)?))).collect()
    }

    async fn delete_profile(
        &self,
        rig: &Name,
        lens: &Name,
        condition: Precondition,
    ) -> StoreResult<Result<bool, Option<u32>>> {
        let mut tx = self.write().await?;
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
            .bind(self.clock.now_ms())
            .execute(&mut *tx)
            .await?;
        self.commit(tx, "rows.delete_profile").await?;
        Ok(Ok(true))
    }
}

/// Stores the next revision within a transaction that the caller commits.
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
    let profile = new_revision(rig, lens, revision, draft, now_ms)?;
    let (body, head) = stored(&profile)?;
    let seq: i64 =
        sqlx::query_scalar("INSERT INTO revisions (rig, lens, revision, body) VALUES (?1, ?2, ?3, ?4) RETURNING seq")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .bind(revision)
            .bind(body)
            .fetch_one(&mut *connection)
            .await?;
    insert_head(connection, seq, &head).await?;
    Ok(profile)
}

/// Writes the summary of each revision that was stored before summaries existed. A revision that cannot be read gets
/// none.
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
        match read(&row.label(), &row.json) {
            Ok(profile) => insert_head(&mut tx, row.seq, &summary(&profile)?).await?,
            Err(error) => tracing::error!(row = row.label(), ?error, "a revision cannot be read"),
        }
    }
    step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot write the summaries of profiles".into()))?;
    tx.commit().await?;
    Ok(())
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

/// Stores the summary of a revision.
async fn insert_head(connection: &mut SqliteConnection, seq: i64, head: &str) -> StoreResult<()> {
    sqlx::query("INSERT INTO revision_heads (seq, head) VALUES (?1, ?2)")
        .bind(seq)
        .bind(head)
        .execute(connection)
        .await?;
    Ok(())
}
