//! What can be told of a store without opening it: nothing is created, migrated or written.

use std::path::Path;

use anyhow::anyhow;
use sqlx::{Connection, Executor, PgConnection, SqliteConnection, sqlite::SqliteConnectOptions};

use super::{
    DatabaseUrl, StoreResult,
    folder::DATABASE,
    postgres,
    rows::schema::{Schema, UNRELEASED},
    sqlite,
};

/// What a database contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inspection {
    /// Version of its schema; 0: it has none yet.
    pub schema: i64,
    /// The version that this program writes. An older schema is migrated at the next start.
    pub newest_schema: i64,
    /// What is wrong with a schema that cannot be migrated, and what to do.
    pub refused: Option<&'static str>,
    /// Its rows; `None` without a schema, or with a newer one.
    pub rows: Option<Rows>,
    /// Time of a database on another machine, ms since 1970 (UTC).
    pub clock_ms: Option<i64>,
}

impl Inspection {
    fn of(schema: i64, known: &Schema) -> Self {
        let refused = (0 < schema && schema < known.oldest()).then_some(UNRELEASED);
        Self { schema, newest_schema: known.newest(), refused, rows: None, clock_ms: None }
    }
}

/// Numbers of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rows {
    /// Profiles that are not deleted.
    pub profiles: i64,
    /// Queued jobs.
    pub queued: i64,
    /// Tokens, revoked ones too.
    pub tokens: i64,
    /// Tokens that are valid.
    pub valid_tokens: i64,
}

/// Both engines have the same tables.
const ROWS: &str = "SELECT (SELECT count(*) FROM profiles WHERE current_revision IS NOT NULL),
                           (SELECT count(*) FROM jobs WHERE state = 'queued'),
                           (SELECT count(*) FROM tokens),
                           (SELECT count(*) FROM tokens WHERE revoked_at IS NULL)";
const SCHEMA: &str = "SELECT coalesce(max(version), 0) FROM _sqlx_migrations";

/// Reads the database of a data folder. `None`: there is none.
///
/// # Errors
/// When it cannot be read, or is none.
pub async fn of_folder(data_dir: &Path) -> StoreResult<Option<Inspection>> {
    let file = data_dir.join(DATABASE);
    if !file.is_file() {
        return Ok(None);
    }
    let options = SqliteConnectOptions::new().filename(file).read_only(true);
    let mut connection = SqliteConnection::connect_with(&options).await?;
    let has_schema = "SELECT count(*) FROM sqlite_master WHERE name = '_sqlx_migrations'";
    let has_schema: i64 = sqlx::query_scalar(has_schema).fetch_one(&mut connection).await?;
    let schema: i64 = if has_schema == 0 { 0 } else { sqlx::query_scalar(SCHEMA).fetch_one(&mut connection).await? };
    let mut found = Inspection::of(schema, &sqlite::SCHEMA);
    if schema == found.newest_schema {
        found.rows = Some(rows(sqlx::query_as(ROWS).fetch_one(&mut connection).await?));
    }
    connection.close().await?;
    Ok(Some(found))
}

/// Reads a Postgres database.
///
/// # Errors
/// When it cannot be reached or read.
pub async fn of_database(url: &DatabaseUrl) -> StoreResult<Inspection> {
    let mut connection = PgConnection::connect_with(&url.options()?)
        .await
        .map_err(|error| anyhow!(error).context(format!("cannot connect to {url}")))?;
    connection.execute("SET default_transaction_read_only = on").await?;
    let clock: i64 = sqlx::query_scalar(postgres::NOW).fetch_one(&mut connection).await?;
    let has_schema: bool =
        sqlx::query_scalar("SELECT to_regclass('_sqlx_migrations') IS NOT NULL").fetch_one(&mut connection).await?;
    let schema: i64 = if has_schema { sqlx::query_scalar(SCHEMA).fetch_one(&mut connection).await? } else { 0 };
    let mut found = Inspection { clock_ms: Some(clock), ..Inspection::of(schema, &postgres::SCHEMA) };
    if schema == found.newest_schema {
        found.rows = Some(rows(sqlx::query_as(ROWS).fetch_one(&mut connection).await?));
    }
    connection.close().await?;
    Ok(found)
}

fn rows((profiles, queued, tokens, valid_tokens): (i64, i64, i64, i64)) -> Rows {
    Rows { profiles, queued, tokens, valid_tokens }
}
