//! Conversion of errors of SQLite into errors of the store.

use super::StoreError;

/// Primary result code of SQLite for "the disk (or the quota) is full".
const SQLITE_FULL: i32 = 13;
/// Extended code for "the shared-memory file beside the WAL cannot grow": a full disk too.
const SQLITE_IOERR_SHMSIZE: i32 = 4874;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let code = error.as_database_error().and_then(|e| e.code()).and_then(|code| code.parse::<i32>().ok());
        match code {
            // the low byte of an extended code is the primary one
            Some(code) if code & 0xff == SQLITE_FULL || code == SQLITE_IOERR_SHMSIZE => {
                Self::DiskFull("the database cannot grow".into())
            }
            _ => Self::Other(anyhow::Error::new(error).context("the database reported an error")),
        }
    }
}

impl From<serde_json::Error> for StoreError {
    fn from(error: serde_json::Error) -> Self {
        Self::Other(anyhow::Error::new(error).context("a row contains JSON that this version cannot read"))
    }
}
