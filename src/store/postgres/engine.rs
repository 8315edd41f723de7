//! What the statements in `store/sql` need of Postgres: connections, transactions, and the parts of SQL that differ.

use std::{sync::Arc, time::Duration};

use anyhow::anyhow;
use sqlx::{Executor, PgPool, Transaction};
use uuid::Uuid;

use super::notifications::Notifications;
use crate::store::{
    Clock, StoreError, StoreResult,
    rows::{
        clock_gaps::LastSeen,
        expired_leases::LeaseObserver,
        transaction::{self, Listeners, Lock, Notice},
    },
};

pub(super) type Db = sqlx::Postgres;
pub(super) type Connection = sqlx::PgConnection;
pub(super) type Metadata = PostgresMetadata;

/// First key of the advisory locks of this program, and the schema: two stores in one database do not wait for each
/// other.
const LOCK: &str = "SELECT pg_advisory_xact_lock(hashtext('pinstack ' || current_schema()), $1)";

/// The time of the database, ms since 1970 (UTC). Not `now()`, which is that of the start of the transaction.
pub(in crate::store) const NOW: &str = "SELECT floor(extract(epoch FROM clock_timestamp()) * 1000)::bigint";

/// Longest time that a worker waits for the database; more than a statement may take. A network that fails without a
/// word never answers, and a worker that waits for ever neither notices a cancellation nor takes another job.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(45);

/// The source of wall-clock time.
pub(super) enum Wall {
    /// The database.
    Database,
    /// A test.
    Given(Arc<dyn Clock>),
}

/// The metadata store in a Postgres database.
pub struct PostgresMetadata {
    pub(super) pool: PgPool,
    pub(super) wall: Wall,
    /// Monotonic time of this process.
    pub(super) clock: Arc<dyn Clock>,
    pub(super) observer: LeaseObserver,
    pub(super) last_seen: LastSeen,
    pub(super) listeners: Listeners,
    pub(super) notifications: Notifications,
}

impl PostgresMetadata {
    /// The connections for statements that read.
    pub(super) fn reading(&self) -> &PgPool {
        &self.pool
    }

    /// A transaction that sees what others have committed before each of its statements.
    pub(super) async fn write(&self) -> StoreResult<Transaction<'static, Db>> {
        Ok(self.pool.begin().await?)
    }

    /// A transaction that holds an advisory lock.
    pub(super) async fn write_alone(&self, lock: Lock) -> StoreResult<Transaction<'static, Db>> {
        let mut tx = self.write().await?;
        take(&mut tx, lock).await?;
        Ok(tx)
    }

    /// Runs an operation that frees space or ends work. The disk of the database is another one than that of the files.
    pub(super) async fn freeing<T, F>(&self, operation: impl Fn() -> F) -> StoreResult<T>
    where
        F: Future<Output = StoreResult<T>>,
    {
        operation().await
    }

    /// Nothing is reserved.
    pub(super) async fn reserve_space(&self) {}

    /// The wall-clock time, ms.
    pub(super) async fn now(&self, executor: impl Executor<'_, Database = Db>) -> StoreResult<i64> {
        match &self.wall {
            Wall::Database => Ok(sqlx::query_scalar(NOW).fetch_one(executor).await?),
            Wall::Given(clock) => Ok(clock.now_ms()),
        }
    }

    /// Commits, and tells the listeners of every process.
    pub(super) async fn commit(
        &self,
        mut tx: Transaction<'static, Db>,
        name: &'static str,
        notice: Notice<'_>,
    ) -> StoreResult<()> {
        self.notifications.send(&mut tx, notice).await?;
        transaction::commit(tx, name).await?;
        self.listeners.tell(notice);
        Ok(())
    }
}

/// Takes an advisory lock within a transaction.
pub(super) async fn take(connection: &mut Connection, lock: Lock) -> StoreResult<()> {
    sqlx::query(LOCK).bind(lock as i32).execute(connection).await?;
    Ok(())
}

/// The result of an operation of a worker, if the database answers in time.
pub(super) async fn answered<T>(operation: impl Future<Output = StoreResult<T>>) -> StoreResult<T> {
    match tokio::time::timeout(ANSWER_TIMEOUT, operation).await {
        Ok(result) => result,
        Err(_) => {
            let seconds = ANSWER_TIMEOUT.as_secs();
            Err(StoreError::Unavailable(anyhow!("the database did not answer within {seconds} s")))
        }
    }
}

/// Ids as a parameter of `dialect!(IN "$1")`.
pub(super) fn id_list(ids: &[Uuid]) -> &[Uuid] {
    ids
}

/// Parts of statements that differ between the engines.
macro_rules! dialect {
    (IN $ids:literal) => {
        concat!("= ANY(", $ids, ")")
    };
    (INDEXED BY jobs_that_wait) => {
        ""
    };
    (FOR UPDATE) => {
        " FOR UPDATE"
    };
    (FOR UPDATE SKIP LOCKED) => {
        " FOR UPDATE SKIP LOCKED"
    };
}
pub(super) use dialect;
