//! What the statements in `store/sql` need of SQLite: connections, transactions, and the parts of SQL that differ.

use std::sync::Arc;

use sqlx::{Executor, SqlitePool, Transaction};
use uuid::Uuid;

use super::reserve::Reserve;
use crate::store::{
    Clock, StoreResult,
    rows::{
        clock_gaps::LastSeen,
        expired_leases::LeaseObserver,
        transaction::{self, Listeners, Lock, Notice},
    },
};

pub(super) type Db = sqlx::Sqlite;
pub(super) type Connection = sqlx::SqliteConnection;
pub(super) type Metadata = SqliteMetadata;

/// The metadata store in one SQLite file.
pub struct SqliteMetadata {
    pub(super) writer: SqlitePool,
    pub(super) readers: SqlitePool,
    pub(super) reserve: Reserve,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) observer: LeaseObserver,
    pub(super) last_seen: LastSeen,
    pub(super) listeners: Listeners,
}

impl SqliteMetadata {
    /// The connections for statements that read.
    pub(super) fn reading(&self) -> &SqlitePool {
        &self.readers
    }

    /// A transaction that holds the write lock from its first statement on.
    pub(in crate::store) async fn write(&self) -> StoreResult<Transaction<'static, Db>> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// The same: the write lock is stronger than any [`Lock`].
    pub(super) async fn write_alone(&self, _: Lock) -> StoreResult<Transaction<'static, Db>> {
        self.write().await
    }

    /// Runs an operation that frees space or ends work: on a full disk with the space that is reserved for it.
    pub(in crate::store) async fn freeing<T, F>(&self, operation: impl Fn() -> F) -> StoreResult<T>
    where
        F: Future<Output = StoreResult<T>>,
    {
        self.reserve.freeing(operation).await
    }

    /// Makes the reserve of the operation above.
    pub(super) async fn reserve_space(&self) {
        self.reserve.fill().await;
    }

    /// The wall-clock time, ms.
    pub(super) async fn now(&self, _: impl Executor<'_, Database = Db>) -> StoreResult<i64> {
        Ok(self.clock.now_ms())
    }

    /// Commits, and tells the listeners of this process.
    pub(super) async fn commit(
        &self,
        tx: Transaction<'static, Db>,
        name: &'static str,
        notice: Notice<'_>,
    ) -> StoreResult<()> {
        transaction::commit(tx, name).await?;
        self.listeners.tell(notice);
        Ok(())
    }
}

/// Takes nothing: the transaction holds the write lock.
pub(super) async fn take(_: &mut Connection, _: Lock) -> StoreResult<()> {
    Ok(())
}

/// The result of an operation of a worker: a file always answers.
pub(super) async fn answered<T>(operation: impl Future<Output = StoreResult<T>>) -> StoreResult<T> {
    operation.await
}

/// Ids as a parameter of `dialect!(IN "$1")`: a JSON list of their hexadecimal digits.
pub(super) fn id_list(ids: &[Uuid]) -> String {
    let quoted: Vec<String> = ids.iter().map(|id| format!("\"{}\"", id.simple())).collect();
    format!("[{}]", quoted.join(","))
}

/// Parts of statements that differ between the engines.
macro_rules! dialect {
    (IN $ids:literal) => {
        concat!("IN (SELECT unhex(value) FROM json_each(", $ids, "))")
    };
    (INDEXED BY jobs_that_wait) => {
        " INDEXED BY jobs_that_wait"
    };
    (FOR UPDATE $(SKIP LOCKED)?) => {
        ""
    };
}
pub(super) use dialect;
