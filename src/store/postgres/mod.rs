//! The metadata store in a Postgres database, which the processes of several machines share.
//!
//! | question | answer |
//! |---|---|
//! | whose clock | that of the database. The clocks of the machines that run pinstack are not compared; only how long a lease has not changed is measured by the monotonic clock of the process that looks |
//! | isolation | `READ COMMITTED`. A transaction first locks what it decides on: the row that it changes (`FOR UPDATE`), or one of a few advisory locks ([`Lock`]) where the decision is over many rows |
//! | why not `SERIALIZABLE` | the limit of the queue and a quota are sums over all rows, so any two acceptances conflict; they would fail and be retried under load, where a lock lets them pass one after the other, in a few milliseconds each |
//! | who is told of a change | every process that listens, by `NOTIFY` within the transaction. A notification that is lost delays only: every listener polls as well |
//!
//! Needs Postgres 13 or later, and connections of its own: a pooler that gives each transaction another connection
//! (PgBouncer in transaction mode) loses the notifications.

mod clock_gaps;
mod expiry;
mod jobs;
mod leases;
mod notifications;
mod options;
mod profiles;
mod quota;
mod scans;
mod storage;
mod tokens;
mod totals;
mod transitions;
mod uploads;

pub use options::DatabaseUrl;

use std::{path::Path, sync::Arc, time::Duration};

use anyhow::anyhow;
use async_trait::async_trait;
use sqlx::{
    Executor, PgConnection, PgPool, Postgres, SqlSafeStr, Transaction,
    migrate::{MigrateError, Migration, MigrationType, Migrator},
    postgres::PgPoolOptions,
};
use tokio::sync::broadcast;
use uuid::Uuid;

use notifications::Kind;

use super::{
    Clock, MetadataStore, StoreError, StoreResult, SystemClock, Totals, failpoint::step, rows, sqlite::SqliteMetadata,
};

/// Most connections of a process.
const CONNECTIONS: u32 = 10;
/// How long a request waits for a connection: a server that restarts is back within that time, usually.
const ACQUIRE_TIMEOUT: Duration = Duration::from_secs(10);
/// Changes that a slow listener may lag behind before it must read the rows again.
const CHANGES: usize = 1024;
/// The same for arrivals, of which one is as good as many.
const ARRIVALS: usize = 1;

/// The migrations of the schema, in order. A published one is never edited.
const SCHEMA: [(i64, &str, &str); 4] = [
    (1, "rows", include_str!("schema/0001_rows.sql")),
    (2, "store", include_str!("schema/0002_store.sql")),
    (3, "trace", include_str!("schema/0003_trace.sql")),
    (4, "turns", include_str!("schema/0004_turns.sql")),
];

/// The newest version of the schema.
pub(in crate::store) const NEWEST_SCHEMA: i64 = SCHEMA[SCHEMA.len() - 1].0;

/// Advisory locks, held until the transaction ends. Against deadlocks, `Accept` and `Expiry` are taken first and never
/// together; only `Profiles` may be taken after another lock or after the lock of a row.
#[derive(Debug, Clone, Copy)]
enum Lock {
    /// Jobs and uploads are accepted, scans written and deleted one at a time: the limits are sums over all rows, and
    /// the numbers that order the queue are given in the order of the commits.
    Accept = 1,
    /// Revisions are numbered.
    Profiles = 2,
    /// Rows expire: many are deleted at once.
    Expiry = 3,
}

/// First key of the advisory locks of this program, and the schema: two stores in one database do not wait for each
/// other.
const LOCK: &str = "SELECT pg_advisory_xact_lock(hashtext('pinstack ' || current_schema()), $1)";

/// The time of the database, ms since 1970 (UTC). Not `now()`, which is that of the start of the transaction.
pub(in crate::store) const NOW: &str = "SELECT floor(extract(epoch FROM clock_timestamp()) * 1000)::bigint";

/// The source of wall-clock time.
enum Wall {
    /// The database.
    Database,
    /// A test.
    Given(Arc<dyn Clock>),
}

/// The metadata store in a Postgres database.
pub struct PostgresMetadata {
    pool: PgPool,
    wall: Wall,
    /// Monotonic time of this process.
    clock: Arc<dyn Clock>,
    observer: rows::expired_leases::LeaseObserver,
    last_seen: rows::clock_gaps::LastSeen,
    changes: broadcast::Sender<Uuid>,
    arrivals: broadcast::Sender<()>,
    notifications: notifications::Notifications,
}

impl PostgresMetadata {
    /// Connects and migrates the schema, with the clock of the database.
    ///
    /// # Errors
    /// When the database cannot be reached or written, or a newer version of the program migrated it.
    pub async fn open(url: &DatabaseUrl) -> StoreResult<Self> {
        Self::connect(url, Wall::Database, Arc::new(SystemClock)).await
    }

    /// The same with another clock, for tests.
    ///
    /// # Errors
    /// As [`PostgresMetadata::open`].
    pub async fn open_with_clock(url: &DatabaseUrl, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        Self::connect(url, Wall::Given(Arc::clone(&clock)), clock).await
    }

    async fn connect(url: &DatabaseUrl, wall: Wall, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        let pool = PgPoolOptions::new()
            .max_connections(CONNECTIONS)
            .acquire_timeout(ACQUIRE_TIMEOUT)
            .after_connect(|connection, _| Box::pin(make_durable(connection)))
            .connect_with(url.options()?)
            .await
            .map_err(|error| anyhow!(error).context(format!("database_url: cannot connect to {url}")))?;
        step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot migrate".into()))?;
        migrate(&pool, url).await?;
        let (changes, _) = broadcast::channel(CHANGES);
        let (arrivals, _) = broadcast::channel(ARRIVALS);
        let notifications = notifications::Notifications::start(&pool, changes.clone(), arrivals.clone()).await?;
        let (observer, last_seen) = Default::default();
        Ok(Self { pool, wall, clock, observer, last_seen, changes, arrivals, notifications })
    }

    /// Requires that there are no rows.
    ///
    /// # Errors
    /// When there are, or the database cannot be read.
    pub async fn require_empty(&self) -> StoreResult<()> {
        let mut connection = self.pool.acquire().await?;
        refuse_filled(&mut connection).await
    }

    /// Takes over all rows of a database file, such as that of a backup. The database must not have any.
    ///
    /// # Errors
    /// When the database has rows, or one of the two cannot be read or written. Then nothing was taken over.
    pub async fn fill_from(&self, file: &Path) -> StoreResult<()> {
        let from = SqliteMetadata::open(file).await?;
        let mut reader = from.write().await?;
        let mut tx = self.write_alone(Lock::Accept).await?;
        take(&mut tx, Lock::Profiles).await?;
        refuse_filled(&mut tx).await?;
        // a new database has seen a clock, which the file has as well
        sqlx::query("DELETE FROM clock_seen").execute(&mut *tx).await?;
        sqlx::query("DELETE FROM clock_gaps").execute(&mut *tx).await?;
        rows::transfer::to_postgres_from(&mut reader, &mut tx).await?;
        drop(reader);
        from.close().await;
        self.commit(tx, "restore.commit").await
    }

    /// A transaction that sees what others have committed before each of its statements.
    async fn write(&self) -> StoreResult<Transaction<'static, Postgres>> {
        Ok(self.pool.begin().await?)
    }

    /// A transaction that holds an advisory lock.
    async fn write_alone(&self, lock: Lock) -> StoreResult<Transaction<'static, Postgres>> {
        let mut tx = self.write().await?;
        take(&mut tx, lock).await?;
        Ok(tx)
    }

    /// The wall-clock time, ms.
    async fn now(&self, executor: impl Executor<'_, Database = Postgres>) -> StoreResult<i64> {
        match &self.wall {
            Wall::Database => Ok(sqlx::query_scalar(NOW).fetch_one(executor).await?),
            Wall::Given(clock) => Ok(clock.now_ms()),
        }
    }

    /// Commits, with a failpoint before and one after. A fault after the commit leaves the caller uncertain whether the
    /// rows were stored, as a real one may.
    async fn commit(&self, transaction: Transaction<'static, Postgres>, name: &'static str) -> StoreResult<()> {
        let broken = |error| StoreError::of_io(error, format!("cannot commit {name}"));
        step(name).map_err(broken)?;
        transaction.commit().await?;
        step(name).map_err(broken)
    }

    /// The same, and notifies the listeners of every process.
    async fn commit_changes(
        &self,
        transaction: Transaction<'static, Postgres>,
        name: &'static str,
        ids: &[Uuid],
    ) -> StoreResult<()> {
        self.commit_and_tell(transaction, name, ids, Kind::Change).await
    }

    /// The same for jobs that joined the queue: workers hear of them too.
    async fn commit_arrivals(
        &self,
        transaction: Transaction<'static, Postgres>,
        name: &'static str,
        ids: &[Uuid],
    ) -> StoreResult<()> {
        self.commit_and_tell(transaction, name, ids, Kind::Arrival).await?;
        let _ = self.arrivals.send(());
        Ok(())
    }

    async fn commit_and_tell(
        &self,
        mut transaction: Transaction<'static, Postgres>,
        name: &'static str,
        ids: &[Uuid],
        kind: Kind,
    ) -> StoreResult<()> {
        self.notifications.send(&mut transaction, ids, kind).await?;
        self.commit(transaction, name).await?;
        for id in ids {
            let _ = self.changes.send(*id);
        }
        Ok(())
    }
}

async fn refuse_filled(connection: &mut PgConnection) -> StoreResult<()> {
    let filled = rows::transfer::filled_tables(connection).await?;
    if filled.is_empty() {
        return Ok(());
    }
    let tables = filled.join(", ");
    Err(anyhow!("database_url: the database has rows already (in {tables}); use a new database, or another schema")
        .into())
}

/// Takes an advisory lock within a transaction.
async fn take(connection: &mut PgConnection, lock: Lock) -> StoreResult<()> {
    sqlx::query(LOCK).bind(lock as i32).execute(connection).await?;
    Ok(())
}

/// A commit that was acknowledged must be on stable storage, also where the database is configured for less.
async fn make_durable(connection: &mut PgConnection) -> Result<(), sqlx::Error> {
    sqlx::query(
        "SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off'",
    )
    .execute(connection)
    .await?;
    Ok(())
}

/// Migrates the schema. Processes that start at once wait for each other: the migrator takes an advisory lock.
async fn migrate(pool: &PgPool, url: &DatabaseUrl) -> StoreResult<()> {
    let migrations = SCHEMA.map(|(version, name, sql)| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    });
    match Migrator::with_migrations(migrations.to_vec()).run(pool).await {
        Ok(()) => Ok(()),
        Err(MigrateError::VersionMissing(version)) => Err(anyhow!(
            "database_url: a newer version of pinstack migrated the database {url} (to schema {version}); \
             run that version or a later one"
        )
        .into()),
        Err(error) => Err(anyhow!(error).context(format!("database_url: cannot migrate {url}")).into()),
    }
}

#[async_trait]
impl MetadataStore for PostgresMetadata {
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
        // foreign keys, checks and triggers hold while the database runs; a revision without summary is listed in full
        sqlx::query("SELECT 1").execute(&self.pool).await?;
        Ok(Vec::new())
    }

    async fn healthy(&self) -> bool {
        let answer = sqlx::query("SELECT 1").execute(&self.pool);
        matches!(tokio::time::timeout(Duration::from_secs(2), answer).await, Ok(Ok(_)))
    }

    async fn snapshot_to(&self, file: &Path) -> StoreResult<()> {
        if file.exists() {
            return Err(anyhow!("{} exists already", file.display()).into());
        }
        let copy = SqliteMetadata::open(file).await?;
        // all tables as of one moment; writers do not wait
        let mut from = self.pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY").await?;
        // a statement reads a whole table, as slowly as it is written here
        sqlx::query("SET LOCAL statement_timeout = 0").execute(&mut *from).await?;
        let mut to = copy.write().await?;
        rows::transfer::from_postgres(&mut from, &mut to).await?;
        step("backup.snapshot").map_err(|error| StoreError::of_io(error, "cannot copy the database".into()))?;
        to.commit().await?;
        copy.close().await;
        Ok(())
    }

    async fn close(&self) {
        self.notifications.stop();
        self.pool.close().await;
    }
}

#[cfg(test)]
mod test_server;
#[cfg(test)]
mod tests;
