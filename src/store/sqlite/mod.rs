//! The metadata store in one SQLite file: WAL, `synchronous=FULL`, one writing connection per process, a pool of
//! reading connections.
//!
//! Several processes may share the file. A transaction that reads before it writes starts with `BEGIN IMMEDIATE`, so no
//! other process writes between the two.

mod clock_gaps;
mod expiry;
mod jobs;
mod leases;
mod profiles;
mod quota;
mod scans;
mod tokens;
mod totals;
mod transitions;
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

use super::{Clock, MetadataStore, StoreError, StoreResult, SystemClock, Totals, failpoint::step, folder, rows};

/// How long a statement waits for a writer in another process.
const BUSY_TIMEOUT: Duration = Duration::from_secs(20);
/// Number of reading connections.
const READERS: u32 = 4;
/// Rows that a connection reads ahead of the consumer.
const ROWS_AHEAD: usize = 4;
/// Changes that a slow listener may lag behind before it must read the rows again.
const CHANGES: usize = 1024;
/// The same for arrivals, of which one is as good as many.
const ARRIVALS: usize = 1;

/// The migrations of the schema, in order. A published one is never edited.
const SCHEMA: [(i64, &str, &str); 10] = [
    (1, "rows", include_str!("schema/0001_rows.sql")),
    (2, "uploads", include_str!("schema/0002_uploads.sql")),
    (3, "tokens", include_str!("schema/0003_tokens.sql")),
    (4, "retention", include_str!("schema/0004_retention.sql")),
    (5, "totals", include_str!("schema/0005_totals.sql")),
    (6, "heads", include_str!("schema/0006_heads.sql")),
    (7, "pauses", include_str!("schema/0007_pauses.sql")),
    (8, "scans", include_str!("schema/0008_scans.sql")),
    (9, "trace", include_str!("schema/0009_trace.sql")),
    (10, "turns", include_str!("schema/0010_turns.sql")),
];

/// The newest version of the schema.
pub(in crate::store) const NEWEST_SCHEMA: i64 = SCHEMA[SCHEMA.len() - 1].0;

/// The metadata store in one SQLite file.
pub struct SqliteMetadata {
    writer: SqlitePool,
    readers: SqlitePool,
    clock: Arc<dyn Clock>,
    observer: rows::expired_leases::LeaseObserver,
    last_seen: rows::clock_gaps::LastSeen,
    changes: broadcast::Sender<Uuid>,
    arrivals: broadcast::Sender<()>,
}

impl SqliteMetadata {
    /// Opens the file, creates it if it is missing, and migrates its schema.
    ///
    /// # Errors
    /// When the file cannot be opened or written, or a newer version of the program created it.
    pub async fn open(path: impl AsRef<Path>) -> StoreResult<Self> {
        Self::open_with_clock(path, Arc::new(SystemClock)).await
    }

    /// The same with another clock, for tests.
    ///
    /// # Errors
    /// As [`SqliteMetadata::open`].
    pub async fn open_with_clock(path: impl AsRef<Path>, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        let path = path.as_ref();
        // two processes that start at once must not both migrate the schema
        let lock = lock_beside(path).await?;
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT)
            // a row may have a megabyte, so only a few are read ahead
            .row_buffer_size(ROWS_AHEAD);
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot migrate".into()))?;
        migrator().run(&writer).await.with_context(|| format!("cannot migrate {}", path.display()))?;
        profiles::fill_heads(&writer).await?;
        for ending in ["", "-wal", "-shm", ".lock"] {
            keep_private(path, ending)?;
        }
        drop(lock);
        let reading = options.pragma("query_only", "ON");
        let readers = SqlitePoolOptions::new().max_connections(READERS).connect_with(reading).await?;
        let (changes, _) = broadcast::channel(CHANGES);
        Ok(Self {
            writer,
            readers,
            clock,
            observer: rows::expired_leases::LeaseObserver::default(),
            last_seen: rows::clock_gaps::LastSeen::default(),
            changes,
            arrivals: broadcast::channel(ARRIVALS).0,
        })
    }

    /// A transaction that holds the write lock from its first statement on.
    pub(in crate::store) async fn write(&self) -> StoreResult<Transaction<'static, Sqlite>> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// Commits, with a failpoint before and one after. A fault after the commit leaves the caller uncertain whether the
    /// rows were stored, as a real one may.
    async fn commit(&self, transaction: Transaction<'static, Sqlite>, name: &'static str) -> StoreResult<()> {
        let broken = |error| StoreError::of_io(error, format!("cannot commit {name}"));
        step(name).map_err(broken)?;
        transaction.commit().await?;
        step(name).map_err(broken)
    }

    /// Tells the workers of this process that jobs joined the queue.
    fn arrived(&self) {
        let _ = self.arrivals.send(());
    }

    /// Notifies the listeners of this process, if there are any.
    fn changed(&self, id: Uuid) {
        let _ = self.changes.send(id);
    }
}

/// Restricts the mode of a database file: the database contains everything but the images.
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
    Ok(locked
        .await
        .context("the task that locks the database panicked")?
        .with_context(|| format!("cannot lock {}.lock", path.display()))?)
}

#[async_trait]
impl MetadataStore for SqliteMetadata {
    fn changes(&self) -> broadcast::Receiver<Uuid> {
        self.changes.subscribe()
    }

    fn arrivals(&self) -> broadcast::Receiver<()> {
        self.arrivals.subscribe()
    }

    async fn totals(&self) -> StoreResult<Totals> {
        totals::totals(self).await
    }

    async fn integrity_errors(&self) -> StoreResult<Vec<String>> {
        let found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check").fetch_all(&self.readers).await?;
        let loose: Vec<(String, Option<i64>, String, i64)> =
            sqlx::query_as("PRAGMA foreign_key_check").fetch_all(&self.readers).await?;
        let found = found.into_iter().filter(|line| line != "ok").map(|line| format!("the database: {line}"));
        let loose = loose.into_iter().map(|(table, row, parent, _)| {
            format!("the database: row {row:?} of {table} refers to a row of {parent} that does not exist")
        });
        Ok(found.chain(loose).collect())
    }

    async fn healthy(&self) -> bool {
        let answer = sqlx::query("SELECT 1").execute(&self.readers);
        matches!(tokio::time::timeout(Duration::from_secs(2), answer).await, Ok(Ok(_)))
    }

    async fn snapshot_to(&self, path: &Path) -> StoreResult<()> {
        let path = path.to_str().context("the path of a backup must be UTF-8")?;
        step("backup.snapshot").map_err(|error| StoreError::of_io(error, "cannot copy the database".into()))?;
        // a reading connection is query_only, which forbids VACUUM INTO as well
        let mut connection = self.writer.acquire().await?;
        sqlx::query("VACUUM INTO ?1").bind(path).execute(&mut *connection).await?;
        Ok(())
    }

    async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

#[cfg(test)]
mod tests;
