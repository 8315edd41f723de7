//! Rows in SQLite: WAL, `synchronous=FULL`, one writing connection per process, a pool for reading.
//!
//! Several processes may work on one file. Whatever reads and then writes does so inside `BEGIN IMMEDIATE`, so what
//! was read still holds when it is written.

mod end;
mod error;
mod jobs;
mod lease;
mod lost;
mod observed;
mod page;
mod profiles;
mod quota;
mod retention;
mod row;
mod tokens;
mod totals;
mod uploads;

use std::{fs::File, path::Path, sync::Arc, time::Duration};

use anyhow::Context;
use async_trait::async_trait;
use sqlx::{
    SqlSafeStr, Sqlite, SqlitePool, Transaction,
    migrate::{Migration, MigrationType, Migrator},
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous},
};
use tokio::sync::broadcast;
use uuid::Uuid;

use super::{
    Attempt, BlobOwner, CancelRequest, Clock, Enqueue, Finish, Heartbeat, Job, JobCounts, JobFilter, NewJob, Page,
    PageRequest, Precondition, ProfileDraft, PutProfile, Rows, StoreError, StoreResult, SystemClock, Totals, folder,
    step::step, sweep::Retention,
};
use crate::contract::{JobKind, Name, ProfileSummary, Progress, profile::Profile};

/// How long a statement waits for another process that writes.
const BUSY_TIMEOUT: Duration = Duration::from_secs(20);
/// Connections for reading.
const READERS: u32 = 4;
/// Rows that are read before somebody takes them.
const ROWS_AHEAD: usize = 4;
/// Changes that a slow listener may lag behind before it has to look at the rows again.
const CHANGES: usize = 1024;

/// Every change of the schema, in order. A published one is never edited.
const SCHEMA: [(i64, &str, &str); 7] = [
    (1, "rows", include_str!("schema/0001_rows.sql")),
    (2, "uploads", include_str!("schema/0002_uploads.sql")),
    (3, "tokens", include_str!("schema/0003_tokens.sql")),
    (4, "retention", include_str!("schema/0004_retention.sql")),
    (5, "totals", include_str!("schema/0005_totals.sql")),
    (6, "heads", include_str!("schema/0006_heads.sql")),
    (7, "pauses", include_str!("schema/0007_pauses.sql")),
];

/// Rows in one SQLite file.
pub struct SqliteRows {
    writer: SqlitePool,
    readers: SqlitePool,
    clock: Arc<dyn Clock>,
    leases: lost::Watched,
    seen: observed::Seen,
    changes: broadcast::Sender<Uuid>,
}

impl SqliteRows {
    /// Opens the file, makes it when it is missing, and brings its schema up to date.
    ///
    /// # Errors
    /// When the file cannot be opened or written, or a newer version of the program made it.
    pub async fn open(path: impl AsRef<Path>) -> StoreResult<Self> {
        Self::open_with_clock(path, Arc::new(SystemClock)).await
    }

    /// The same with another clock: for tests.
    ///
    /// # Errors
    /// As [`SqliteRows::open`].
    pub async fn open_with_clock(path: impl AsRef<Path>, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        let path = path.as_ref();
        // Two processes that start at once must not both change the schema.
        let lock = lock_beside(path).await?;
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT)
            // a row may have a megabyte, so only a few are read ahead of the reader
            .row_buffer_size(ROWS_AHEAD);
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot migrate".into()))?;
        migrator().run(&writer).await.with_context(|| format!("cannot bring {} up to date", path.display()))?;
        profiles::fill_heads(&writer).await?;
        for ending in ["", "-wal", "-shm", ".lock"] {
            keep_private(path, ending)?;
        }
        drop(lock);
        let reading = options.pragma("query_only", "ON");
        let readers = SqlitePoolOptions::new().max_connections(READERS).connect_with(reading).await?;
        let (changes, _) = broadcast::channel(CHANGES);
        Ok(Self { writer, readers, clock, leases: lost::Watched::default(), seen: observed::Seen::default(), changes })
    }

    /// Writes all rows, as they are at this moment, into a new file at `path`. Whoever writes meanwhile waits for nothing.
    ///
    /// # Errors
    /// When the file is there already or cannot be written.
    pub async fn snapshot_to(&self, path: &Path) -> StoreResult<()> {
        let path = path.to_str().context("the path of a copy must be UTF-8")?;
        step("backup.snapshot").map_err(|error| StoreError::of_io(error, "cannot copy the rows".into()))?;
        // the readers may only query, and this is a query to all but the new file
        let mut connection = self.writer.acquire().await?;
        sqlx::query("VACUUM INTO ?1").bind(path).execute(&mut *connection).await?;
        Ok(())
    }

    /// Keys of the blobs that the row of a job names, also of one that cannot be read.
    ///
    /// # Errors
    /// When the database does not answer.
    pub async fn named_keys(&self, id: Uuid) -> StoreResult<Vec<String>> {
        jobs::named_keys(self, id).await
    }

    /// Confirms the wall clock after a jump: what has expired by this clock may be removed.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn trust_clock(&self) -> StoreResult<()> {
        observed::trust(self).await
    }

    /// Waits for running statements and closes the file.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }

    /// A transaction that holds the write lock from its first statement on.
    async fn write(&self) -> StoreResult<Transaction<'static, Sqlite>> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// Commits, with a step before and one behind: an error behind it leaves it open whether the rows were stored, as a
    /// real one may.
    async fn commit(&self, transaction: Transaction<'static, Sqlite>, name: &'static str) -> StoreResult<()> {
        let broken = |error| StoreError::of_io(error, format!("cannot commit {name}"));
        step(name).map_err(broken)?;
        transaction.commit().await?;
        step(name).map_err(broken)
    }

    /// Tells the listeners of this process; nobody listening is fine.
    fn changed(&self, id: Uuid) {
        let _ = self.changes.send(id);
    }
}

/// The database tells everything but the pictures.
fn keep_private(path: &Path, ending: &str) -> StoreResult<()> {
    let mut file = path.as_os_str().to_owned();
    file.push(ending);
    let kept = folder::keep_private(Path::new(&file), folder::FILE);
    kept.map_err(|error| StoreError::of_io(error, format!("cannot set the mode of {}", Path::new(&file).display())))
}

fn migrator() -> Migrator {
    let migrations = SCHEMA.map(|(version, name, sql)| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.to_vec())
}

/// An exclusive lock on `{path}.lock`, held until the file is dropped.
async fn lock_beside(path: &Path) -> StoreResult<File> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let locked = tokio::task::spawn_blocking(move || {
        step("rows.lock")?;
        let file = File::options().create(true).truncate(false).write(true).open(&name)?;
        file.lock()?;
        Ok::<_, std::io::Error>(file)
    });
    Ok(locked.await.context("the lock task died")?.with_context(|| format!("cannot lock {}.lock", path.display()))?)
}

#[async_trait]
impl Rows for SqliteRows {
    async fn put_profile(
        &self,
        rig: &Name,
        lens: &Name,
        draft: &ProfileDraft,
        condition: Precondition,
    ) -> StoreResult<PutProfile> {
        profiles::put(self, rig, lens, draft, condition).await
    }

    async fn profile(&self, rig: &Name, lens: &Name, revision: Option<u32>) -> StoreResult<Option<Profile>> {
        profiles::get(self, rig, lens, revision).await
    }

    async fn profile_of_job(&self, rig: &Name, lens: &Name, revision: u32) -> StoreResult<Option<Profile>> {
        profiles::of_job(self, rig, lens, revision).await
    }

    async fn profiles(
        &self,
        rig: Option<&Name>,
        lens: Option<&Name>,
        page: &PageRequest,
    ) -> StoreResult<Page<ProfileSummary>> {
        profiles::list(self, rig, lens, page).await
    }

    async fn revisions(&self, rig: &Name, lens: &Name, page: &PageRequest) -> StoreResult<Page<ProfileSummary>> {
        profiles::revisions(self, rig, lens, page).await
    }

    async fn stored_revisions(&self, page: &PageRequest) -> StoreResult<Page<Profile>> {
        profiles::stored(self, page).await
    }

    async fn profile_keys(&self, limit: u32) -> StoreResult<Vec<(Name, Name)>> {
        profiles::keys(self, limit).await
    }

    async fn delete_profile(
        &self,
        rig: &Name,
        lens: &Name,
        condition: Precondition,
    ) -> StoreResult<Result<bool, Option<u32>>> {
        profiles::delete(self, rig, lens, condition).await
    }

    async fn enqueue(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Enqueue> {
        jobs::enqueue(self, job, queue_limit).await
    }

    async fn by_idempotency_key(&self, key: &str) -> StoreResult<Option<(Job, String)>> {
        jobs::by_idempotency_key(&self.readers, key).await
    }

    async fn job(&self, id: Uuid) -> StoreResult<Option<Job>> {
        jobs::get(self, id).await
    }

    async fn job_kind(&self, id: Uuid) -> StoreResult<Option<JobKind>> {
        jobs::kind_of(self, id).await
    }

    async fn jobs(&self, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>> {
        jobs::list(self, filter, page).await
    }

    async fn counts(&self) -> StoreResult<JobCounts> {
        jobs::counts(self).await
    }

    async fn totals(&self) -> StoreResult<Totals> {
        totals::totals(self).await
    }

    async fn claim(&self, lease: Duration, max_attempts: u32) -> StoreResult<Option<Job>> {
        lease::claim(self, lease, max_attempts).await
    }

    async fn heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat> {
        lease::heartbeat(self, id, lease_token, lease, progress).await
    }

    async fn finish(&self, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool> {
        end::finish(self, id, lease_token, finish).await
    }

    async fn release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool> {
        lease::release(self, id, lease_token, attempt).await
    }

    async fn cancel(&self, id: Uuid) -> StoreResult<Option<CancelRequest>> {
        end::cancel(self, id).await
    }

    async fn delete_job(&self, id: Uuid) -> StoreResult<bool> {
        end::delete(self, id).await
    }

    async fn delete_expired(&self, keep: &Retention) -> StoreResult<Vec<Uuid>> {
        retention::delete_expired(self, keep).await
    }

    async fn expire_job_uploads(&self, keep: &Retention) -> StoreResult<Vec<Uuid>> {
        retention::expire_job_uploads(self, keep).await
    }

    async fn bytes_of(&self, owner: Uuid) -> StoreResult<u64> {
        retention::bytes_of(self, owner).await
    }

    async fn blob_owner(&self, id: Uuid) -> StoreResult<Option<BlobOwner>> {
        jobs::blob_owner(self, id).await
    }

    fn changes(&self) -> broadcast::Receiver<Uuid> {
        self.changes.subscribe()
    }

    async fn objections(&self) -> StoreResult<Vec<String>> {
        let found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check").fetch_all(&self.readers).await?;
        let loose: Vec<(String, Option<i64>, String, i64)> =
            sqlx::query_as("PRAGMA foreign_key_check").fetch_all(&self.readers).await?;
        let found = found.into_iter().filter(|line| line != "ok").map(|line| format!("the database: {line}"));
        let loose = loose.into_iter().map(|(table, row, parent, _)| {
            format!("the database: row {row:?} of {table} names a row of {parent} that is not there")
        });
        Ok(found.chain(loose).collect())
    }

    async fn healthy(&self) -> bool {
        let answer = sqlx::query("SELECT 1").execute(&self.readers);
        matches!(tokio::time::timeout(Duration::from_secs(2), answer).await, Ok(Ok(_)))
    }
}

#[cfg(test)]
mod tests;
