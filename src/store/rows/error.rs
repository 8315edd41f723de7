//! Conversion of errors of the databases into errors of the store.

use sqlx::{error::DatabaseError, postgres::PgDatabaseError, sqlite::SqliteError};

use crate::store::StoreError;

/// Primary result code of SQLite for "the disk (or the quota) is full".
const SQLITE_FULL: i32 = 13;
/// Extended code for "the shared-memory file beside the WAL cannot grow": a full disk too.
const SQLITE_IOERR_SHMSIZE: i32 = 4874;
/// SQLSTATE of Postgres for "the disk is full".
const POSTGRES_DISK_FULL: &str = "53100";

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        if error.as_database_error().is_some_and(says_full) {
            return Self::DiskFull("the database cannot grow".into());
        }
        Self::Other(anyhow::Error::new(error).context("the database reported an error"))
    }
}

/// Each engine numbers its errors in its own way.
fn says_full(error: &(dyn DatabaseError + 'static)) -> bool {
    let Some(code) = error.code() else { return false };
    if error.try_downcast_ref::<SqliteError>().is_some() {
        // the low byte of an extended code is the primary one
        return code.parse::<i32>().is_ok_and(|code| code & 0xff == SQLITE_FULL || code == SQLITE_IOERR_SHMSIZE);
    }
    error.try_downcast_ref::<PgDatabaseError>().is_some() && code == POSTGRES_DISK_FULL
}

impl From<serde_json::Error> for StoreError {
    fn from(error: serde_json::Error) -> Self {
        Self::Other(anyhow::Error::new(error).context("a row contains JSON that this version cannot read"))
    }
}
