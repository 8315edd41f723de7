//! The database file as a whole: opened, migrated, checked, copied, closed.

use std::{fs::File, path::Path, sync::Arc, time::Duration};

use anyhow::Context;
use async_trait::async_trait;
use sqlx::{
    Connection, SqliteConnection, SqlitePool,
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous},
};
use tokio::sync::broadcast;
use uuid::Uuid;

use super::{engine::SqliteMetadata, reserve::Reserve, sql::search::refresh, sql::totals::totals};
use crate::store::{
    Clock, MetadataStore, StoreError, StoreResult, SystemClock, Totals, failpoint::step, folder, rows::schema::Schema,
};

/// How long a statement waits for a writer in another process.
const BUSY_TIMEOUT: Duration = Duration::from_secs(20);
/// How long a check waits for the writing connection: transactions are short.
const WRITE_CHECK_TIMEOUT: Duration = Duration::from_secs(4);
/// Number of reading connections.
const READERS: u32 = 4;
/// Rows that a connection reads ahead of the consumer.
const ROWS_AHEAD: usize = 4;

pub(in crate::store) const SCHEMA: Schema = Schema(&[
    (11, "rows", include_str!("schema/0011_rows.sql")),
    (12, "service", include_str!("schema/0012_service.sql")),
    (13, "reconstructions", include_str!("schema/0013_reconstructions.sql")),
    (14, "search", include_str!("schema/0014_search.sql")),
    (15, "notes", include_str!("schema/0015_notes.sql")),
    (16, "auto", include_str!("schema/0016_auto.sql")),
]);

impl SqliteMetadata {
    /// Opens the file, creates it if it is missing, and migrates its schema.
    ///
    /// # Errors
    /// When the file cannot be opened or written, or a version of the program that knows another schema made it.
    pub async fn open(path: impl AsRef<Path>) -> StoreResult<Self> {
        Self::open_with_clock(path, Arc::new(SystemClock)).await
    }

    /// The same with another clock, for tests.
    ///
    /// # Errors
    /// As [`SqliteMetadata::open`].
    pub async fn open_with_clock(path: impl AsRef<Path>, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        let path = path.as_ref();
        let reserve = Reserve::beside(path);
        // on a full disk too, so that what is stored there can be deleted
        let (writer, readers) = reserve.freeing(|| connect(path)).await?;
        let (observer, last_seen, listeners) = Default::default();
        let store = Self { writer, readers, reserve, clock, observer, last_seen, listeners };
        refresh(&store).await?;
        Ok(store)
    }
}

/// The writing connection and the reading ones, to a file whose schema is migrated.
async fn connect(path: &Path) -> StoreResult<(SqlitePool, SqlitePool)> {
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
    let writer = SqlitePoolOptions::new()
        .max_connections(1)
        .after_release(|connection, _| Box::pin(is_reusable(connection)))
        .connect_with(options.clone())
        .await?;
    step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot migrate".into()))?;
    let migrated = SCHEMA.migrator().run(&writer).await;
    migrated.map_err(|error| SCHEMA.refusal(error, &format!("the database {}", path.display())))?;
    for ending in ["", "-wal", "-shm", ".lock"] {
        keep_private(path, ending)?;
    }
    drop(lock);
    let reading = options.pragma("query_only", "ON");
    let readers = SqlitePoolOptions::new().max_connections(READERS).connect_with(reading).await?;
    Ok((writer, readers))
}

/// False when a transaction of the connection did not end cleanly: the pool then closes it and opens another one. After
/// a full disk or an I/O error SQLite has rolled back by itself, the rollback of the library fails, and it counts the
/// transaction for ever.
async fn is_reusable(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    // answered after the rollback of a transaction that was dropped
    connection.ping().await?;
    Ok(!connection.is_in_transaction())
}

/// Restricts the mode of a database file: the database contains everything but the images.
fn keep_private(path: &Path, ending: &str) -> StoreResult<()> {
    let mut file = path.as_os_str().to_owned();
    file.push(ending);
    let kept = folder::keep_private(Path::new(&file), folder::FILE);
    kept.map_err(|error| StoreError::of_io(error, format!("cannot set the mode of {}", Path::new(&file).display())))
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
        self.listeners.changes.subscribe()
    }

    fn arrivals(&self) -> broadcast::Receiver<()> {
        self.listeners.arrivals.subscribe()
    }

    async fn service_id(&self) -> StoreResult<Uuid> {
        Ok(sqlx::query_scalar("SELECT id FROM service").fetch_one(&self.readers).await?)
    }

    async fn totals(&self) -> StoreResult<Totals> {
        totals(self).await
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
        let check = async {
            sqlx::query("SELECT 1").execute(&self.readers).await?;
            // writes a page of the database as it is, which a full disk refuses; this program does not use the number
            sqlx::query("PRAGMA user_version = 0").execute(&self.writer).await
        };
        matches!(tokio::time::timeout(WRITE_CHECK_TIMEOUT, check).await, Ok(Ok(_)))
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
