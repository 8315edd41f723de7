//! Profiles and their revisions. A revision is stored twice: as a whole (`revisions.body`), and as the summary that
//! lists show (`revision_heads.head`), so that a list does not read megabytes of homographies.

use anyhow::Context;
use async_trait::async_trait;

use super::engine::{Connection, Metadata, take};
use crate::{
    contract::{Name, ProfileSummary, profile::Profile},
    store::{
        DeleteProfile, Page, PageRequest, Precondition, ProfileDraft, ProfileStore, PutProfile, StoreResult, json,
        rows::{
            name,
            page::Window,
            profile::{label, new_revision, parsed, stored},
            transaction::{Lock, Notice},
        },
    },
};

#[async_trait]
impl ProfileStore for Metadata {
    async fn put_profile(
        &self,
        rig: &Name,
        lens: &Name,
        draft: &ProfileDraft,
        condition: Precondition,
    ) -> StoreResult<PutProfile> {
        let mut tx = self.write_alone(Lock::Profiles).await?;
        let now = self.now(&mut *tx).await?;
        let current = current_revision(&mut tx, rig, lens).await?;
        if !condition.holds(current) {
            return Ok(PutProfile::PreconditionFailed(current));
        }
        let profile = insert(&mut tx, rig, lens, draft, now).await?;
        self.commit(tx, "rows.put_profile", Notice::None).await?;
        Ok(match current {
            None => PutProfile::Created(profile),
            Some(_) => PutProfile::Updated(profile),
        })
    }

    async fn profile(&self, rig: &Name, lens: &Name, revision: Option<u32>) -> StoreResult<Option<Profile>> {
        let row: Option<(i64, String)> = sqlx::query_as(
            "SELECT revision, body FROM revisions NATURAL JOIN profiles
             WHERE rig = $1 AND lens = $2 AND revision = COALESCE($3, current_revision) AND deleted_at IS NULL",
        )
        .bind(rig.as_str())
        .bind(lens.as_str())
        .bind(revision.map(i64::from))
        .fetch_optional(self.reading())
        .await?;
        row.map(|(revision, body)| json::read(label(rig, lens, revision), &body)).transpose()
    }

    async fn profile_of_job(&self, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>> {
        let body: Option<String> =
            sqlx::query_scalar("SELECT body FROM revisions WHERE rig = $1 AND lens = $2 AND revision = $3")
                .bind(rig.as_str())
                .bind(lens.as_str())
                .bind(i64::from(revision))
                .fetch_optional(self.reading())
                .await?;
        body.map(|body| json::read(label(rig, lens, revision), &body)).transpose()
    }

    async fn profiles(
        &self,
        rig: Option<&Name>,
        lens: Option<&Name>,
        page: &PageRequest,
    ) -> StoreResult<Page<ProfileSummary>> {
        let window = Window::of("profiles", page)?;
        let rows = sqlx::query_as(
            "SELECT seq, rig, lens, revision, head AS json
             FROM profiles NATURAL JOIN revisions JOIN revision_heads USING (seq)
             WHERE revision = current_revision AND seq < $1
               AND ($2 IS NULL OR rig = $2) AND ($3 IS NULL OR lens = $3)
             ORDER BY seq DESC LIMIT $4",
        )
        .bind(window.before)
        .bind(rig.map(Name::as_str))
        .bind(lens.map(Name::as_str))
        .bind(window.rows)
        .fetch(self.reading());
        parsed(&window, rows).await
    }

    async fn revisions(&self, rig: &Name, lens: &Name, page: &PageRequest) -> StoreResult<Page<ProfileSummary>> {
        let window = Window::of(format!("revisions of {rig}/{lens}"), page)?;
        let rows = sqlx::query_as(
            "SELECT seq, rig, lens, revision, head AS json
             FROM revisions JOIN revision_heads USING (seq)
             WHERE rig = $1 AND lens = $2 AND deleted_at IS NULL AND seq < $3
             ORDER BY seq DESC LIMIT $4",
        )
        .bind(rig.as_str())
        .bind(lens.as_str())
        .bind(window.before)
        .bind(window.rows)
        .fetch(self.reading());
        parsed(&window, rows).await
    }

    async fn all_revisions(&self, page: &PageRequest) -> StoreResult<Page<Profile>> {
        let window = Window::of("all revisions", page)?;
        let rows = sqlx::query_as(
            "SELECT seq, rig, lens, revision, body AS json FROM revisions WHERE seq < $1 ORDER BY seq DESC LIMIT $2",
        )
        .bind(window.before)
        .bind(window.rows)
        .fetch(self.reading());
        parsed(&window, rows).await
    }

    async fn profile_keys(&self, limit: u32) -> StoreResult<Vec<(Name, Name)>> {
        let rows: Vec<(String, String)> = sqlx::query_as(
            "SELECT rig, lens FROM profiles WHERE current_revision IS NOT NULL ORDER BY rig, lens LIMIT $1",
        )
        .bind(i64::from(limit))
        .fetch_all(self.reading())
        .await?;
        rows.into_iter().map(|(rig, lens)| Ok((name(rig)?, name(lens)?))).collect()
    }

    async fn delete_profile(&self, rig: &Name, lens: &Name, condition: Precondition) -> StoreResult<DeleteProfile> {
        self.freeing(|| async {
            let mut tx = self.write_alone(Lock::Profiles).await?;
            let now = self.now(&mut *tx).await?;
            let current = current_revision(&mut tx, rig, lens).await?;
            if !condition.holds(current) {
                return Ok(DeleteProfile::PreconditionFailed(current));
            }
            if current.is_none() {
                return Ok(DeleteProfile::NotFound);
            }
            sqlx::query("UPDATE profiles SET current_revision = NULL WHERE rig = $1 AND lens = $2")
                .bind(rig.as_str())
                .bind(lens.as_str())
                .execute(&mut *tx)
                .await?;
            sqlx::query("UPDATE revisions SET deleted_at = $3 WHERE rig = $1 AND lens = $2 AND deleted_at IS NULL")
                .bind(rig.as_str())
                .bind(lens.as_str())
                .bind(now)
                .execute(&mut *tx)
                .await?;
            sqlx::query("DELETE FROM notes WHERE rig = $1 AND lens = $2")
                .bind(rig.as_str())
                .bind(lens.as_str())
                .execute(&mut *tx)
                .await?;
            self.commit(tx, "rows.delete_profile", Notice::None).await?;
            Ok(DeleteProfile::Deleted)
        })
        .await
    }
}

/// Stores the next revision within a transaction that the caller commits.
pub(super) async fn insert(
    connection: &mut Connection,
    rig: &Name,
    lens: &Name,
    draft: &ProfileDraft,
    now_ms: i64,
) -> StoreResult<Profile> {
    take(connection, Lock::Profiles).await?;
    let revision: i64 = sqlx::query_scalar(
        "INSERT INTO profiles (rig, lens, last_revision, current_revision) VALUES ($1, $2, 1, 1)
         ON CONFLICT (rig, lens) DO UPDATE
         SET last_revision = profiles.last_revision + 1, current_revision = profiles.last_revision + 1
         RETURNING current_revision",
    )
    .bind(rig.as_str())
    .bind(lens.as_str())
    .fetch_one(&mut *connection)
    .await?;
    let revision = u32::try_from(revision).context("a row contains a revision out of range")?;
    let profile = new_revision(rig, lens, revision, draft, now_ms)?;
    let (body, head) = stored(&profile)?;
    let seq: i64 =
        sqlx::query_scalar("INSERT INTO revisions (rig, lens, revision, body) VALUES ($1, $2, $3, $4) RETURNING seq")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .bind(i64::from(revision))
            .bind(body)
            .fetch_one(&mut *connection)
            .await?;
    sqlx::query("INSERT INTO revision_heads (seq, head) VALUES ($1, $2)")
        .bind(seq)
        .bind(head)
        .execute(connection)
        .await?;
    Ok(profile)
}

async fn current_revision(connection: &mut Connection, rig: &Name, lens: &Name) -> StoreResult<Option<u32>> {
    let current: Option<Option<i64>> =
        sqlx::query_scalar("SELECT current_revision FROM profiles WHERE rig = $1 AND lens = $2")
            .bind(rig.as_str())
            .bind(lens.as_str())
            .fetch_optional(connection)
            .await?;
    Ok(current.flatten().and_then(|current| u32::try_from(current).ok()))
}
