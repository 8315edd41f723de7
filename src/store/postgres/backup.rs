//! All rows, copied to a SQLite file and back: the form in which a backup has the rows of any engine.

use std::path::Path;

use anyhow::anyhow;

use super::engine::{Connection, PostgresMetadata, take};
use crate::store::{
    MetadataStore, StoreError, StoreResult,
    failpoint::step,
    rows::{
        transaction::{Lock, Notice},
        transfer,
    },
    sqlite::SqliteMetadata,
};

impl PostgresMetadata {
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
        transfer::to_postgres_from(&mut reader, &mut tx).await?;
        drop(reader);
        from.close().await;
        self.commit(tx, "restore.commit", Notice::None).await
    }

    /// Writes all rows, as of one moment, to a new file.
    pub(super) async fn copy_to(&self, file: &Path) -> StoreResult<()> {
        if file.exists() {
            return Err(anyhow!("{} exists already", file.display()).into());
        }
        let copy = SqliteMetadata::open(file).await?;
        // all tables as of one moment; writers do not wait
        let mut from = self.pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY").await?;
        // a statement reads a whole table, as slowly as it is written here
        sqlx::query("SET LOCAL statement_timeout = 0").execute(&mut *from).await?;
        let mut to = copy.write().await?;
        transfer::from_postgres(&mut from, &mut to).await?;
        step("backup.snapshot").map_err(|error| StoreError::of_io(error, "cannot copy the database".into()))?;
        to.commit().await?;
        copy.close().await;
        Ok(())
    }
}

async fn refuse_filled(connection: &mut Connection) -> StoreResult<()> {
    let filled = transfer::filled_tables(connection).await?;
    if filled.is_empty() {
        return Ok(());
    }
    let tables = filled.join(", ");
    Err(anyhow!("database_url: the database has rows already (in {tables}); use a new database, or another schema")
        .into())
}
