//! Conversion of errors of the databases into errors of the store.

use sqlx::{error::DatabaseError, postgres::PgDatabaseError, sqlite::SqliteError};

use crate::store::StoreError;

/// Primary result code of SQLite for "the disk (or the quota) is full".
const SQLITE_FULL: i32 = 13;
/// Extended code for "the shared-memory file beside the WAL cannot grow": a full disk too.
const SQLITE_IOERR_SHMSIZE: i32 = 4874;
/// Beginnings of the SQLSTATE of Postgres for: the connection broke, too many connections, the server shuts down,
/// crashed or starts, the server cannot reach its files.
const POSTGRES_AWAY: [&str; 4] = ["08", "53300", "57P0", "58"];
/// SQLSTATE of Postgres for "the disk is full".
const POSTGRES_DISK_FULL: &str = "53100";

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        if error.as_database_error().is_some_and(says_full) {
            return Self::DiskFull("the database cannot grow".into());
        }
        if is_away(&error) {
            return Self::Unavailable(anyhow::Error::new(error).context("the database does not answer"));
        }
        Self::Other(anyhow::Error::new(error).context("the database reported an error"))
    }
}

/// True when the database cannot be reached, or shuts down: nothing is wrong with the statement.
fn is_away(error: &sqlx::Error) -> bool {
    match error {
        sqlx::Error::Io(_) | sqlx::Error::Tls(_) | sqlx::Error::PoolTimedOut | sqlx::Error::WorkerCrashed => true,
        sqlx::Error::Database(error) => {
            let code = error.code().unwrap_or_default();
            let is_postgres = error.try_downcast_ref::<PgDatabaseError>().is_some();
            is_postgres && POSTGRES_AWAY.iter().any(|class| code.starts_with(class))
        }
        _ => false,
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
