//! The conformance suite on SQLite, and what is specific to SQLite.

use std::{path::PathBuf, sync::Arc};

use async_trait::async_trait;
use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
use tempfile::TempDir;

use super::SqliteMetadata;
use crate::store::{
    Clock, JobQueue, ManualClock, MetadataStore, StoreError, StoreResult,
    conformance::{self, Fresh, database::Database},
};

/// A database file.
struct Sqlite(PathBuf);

#[async_trait]
impl Database for Sqlite {
    async fn open(&self, clock: Arc<dyn Clock>) -> StoreResult<Arc<dyn MetadataStore>> {
        Ok(Arc::new(SqliteMetadata::open_with_clock(&self.0, clock).await?))
    }

    async fn execute(&self, sql: &'static str) -> Result<Vec<String>, sqlx::Error> {
        let mut connection = SqliteConnection::connect_with(&SqliteConnectOptions::new().filename(&self.0)).await?;
        sqlx::query_scalar(sql).fetch_all(&mut connection).await
    }
}

async fn fresh() -> (TempDir, Fresh) {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let clock = Arc::new(ManualClock::default());
    let database = Arc::new(Sqlite(folder.path().join("metadata.sqlite")));
    let metadata = database.open(clock.clone()).await.expect("open");
    (folder, Fresh { metadata, clock, database })
}

crate::metadata_conformance!(crate::store::sqlite::tests::fresh);

#[tokio::test]
async fn a_full_disk_is_recognised_and_corrupts_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let first = conformance::accept(&store, &conformance::stack()).await;
    // SQLite reports its page limit like a full disk; this limit is below the size of the file, so it cannot grow
    sqlx::query("PRAGMA max_page_count = 1").execute(&store.writer).await.unwrap();
    let mut full = None;
    for _ in 0..200 {
        if let Err(error) = store.enqueue(&conformance::stack(), 1000).await {
            full = Some(error);
            break;
        }
    }
    assert!(matches!(full, Some(StoreError::DiskFull(_))), "{full:?}");
    assert_eq!(store.job(first.id).await.unwrap(), Some(first));
    sqlx::query("PRAGMA max_page_count = 1000000").execute(&store.writer).await.unwrap();
    conformance::accept(&store, &conformance::stack()).await;
}

#[tokio::test]
async fn a_transaction_that_sqlite_rolled_back_by_itself_harms_no_later_one() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    let mut tx = store.write().await.unwrap();
    // what SQLite does after a full disk, an I/O error, or without memory; the library counts the transaction still
    sqlx::query("ROLLBACK").execute(&mut *tx).await.unwrap();
    drop(tx);
    conformance::accept(&store, &conformance::stack()).await;
    assert!(store.healthy().await);
}

#[tokio::test]
async fn a_database_that_cannot_be_written_is_not_healthy_and_recovers() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteMetadata::open(folder.path().join("metadata.sqlite")).await.unwrap();
    assert!(store.healthy().await);
    sqlx::query("PRAGMA query_only = ON").execute(&store.writer).await.unwrap();
    assert!(!store.healthy().await, "it can be read, but not written");
    sqlx::query("PRAGMA query_only = OFF").execute(&store.writer).await.unwrap();
    assert!(store.healthy().await);
}
