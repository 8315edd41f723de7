//! Copies all rows between the two engines: a SQLite file is the form in which a backup holds the rows of any engine.
//!
//! [`TABLES`] lists every table and column; a test compares it with both schemas. Rows go over one at a time, so memory
//! is bounded by the longest one, a profile of a megabyte.

use futures::TryStreamExt;
use sqlx::{
    AssertSqlSafe, PgConnection, Postgres, Row, Sqlite, SqliteConnection, postgres::PgArguments, postgres::PgRow,
    query::Query, sqlite::SqliteRow,
};
use uuid::Uuid;

use crate::store::StoreResult;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::store) enum Kind {
    /// A 64-bit integer.
    Integer,
    /// A 64-bit float.
    Real,
    /// UTF-8 text.
    Text,
    /// Bytes.
    Bytes,
    /// `uuid` in Postgres, 16 bytes in SQLite.
    Id,
    /// `boolean` in Postgres, 0 or 1 in SQLite.
    Flag,
}

/// A table that both engines have.
#[derive(Debug)]
pub(in crate::store) struct Table {
    /// Its name.
    pub name: &'static str,
    /// Its columns.
    pub columns: &'static [(&'static str, Kind)],
    /// `seq` is given by the database.
    is_numbered: bool,
}

use Kind::{Bytes, Flag, Id, Integer, Real, Text};

/// The tables, each as its name, `numbered` if the database gives `seq`, and its columns with what they hold.
macro_rules! tables {
    (@) => { false };
    (@ numbered) => { true };
    ($($name:ident $($numbered:ident)? { $($column:ident $kind:ident),+ $(,)? })+) => {
        [$(Table {
            name: stringify!($name),
            columns: &[$((stringify!($column), $kind)),+],
            is_numbered: tables!(@ $($numbered)?),
        }),+]
    };
}

/// Every table, those first to which others refer.
pub(in crate::store) const TABLES: [Table; 13] = tables! {
    profiles { rig Text, lens Text, last_revision Integer, current_revision Integer }
    revisions numbered { seq Integer, rig Text, lens Text, revision Integer, body Text, deleted_at Integer }
    revision_heads { seq Integer, head Text }
    jobs numbered {
        seq Integer, id Id, kind Text, rig Text, lens Text, scan Text, request Text, state Text, stage Text,
        completed Integer, total Integer, fraction Real, attempt Integer, lease_token Integer, lease_until Integer,
        lease_ms Integer, claim_after Integer, version Integer, created_at Integer, started_at Integer,
        finished_at Integer, keep_ms Integer, cancel_requested Flag, delete_requested Flag, error Text,
        warnings Text, outcome Text, idempotency_key Text, fingerprint Text, owner Id, upload_bytes Integer,
        result_bytes Integer, upload_removed Flag, background Integer, share Text, turn Integer, turn_end Integer,
        trace Text,
    }
    search_terms { term Text, seq Integer }
    search_index { version Integer }
    scans numbered {
        seq Integer, name Text, rig Text, lens Text, body Text, version Integer, owner Id, created_at Integer,
        updated_at Integer, reconstructs Flag, examined Text,
    }
    notes numbered {
        seq Integer, id Id, stack Id, scan Text, rig Text, lens Text, text Text, author Text, created_at Integer,
    }
    uploads {
        id Id, length Integer, received Integer, digest Bytes, metadata Text, job_kind Text, fault Text,
        wanted Integer, created_at Integer, expires_at Integer, owner Id, last_byte_at Integer,
    }
    tokens {
        id Id, name Text, digest Bytes, scopes Text, created_at Integer, revoked_at Integer, quota_bytes Integer,
    }
    clock_seen { id Integer, at_ms Integer }
    clock_gaps { at_ms Integer, gap_ms Integer }
    service { id Id }
};

/// Those of them that have rows in a new database too: a copy replaces these rows.
const OF_NEW: [&str; 4] = ["clock_seen", "clock_gaps", "service", "search_index"];

impl Table {
    fn select(&self) -> String {
        let columns: Vec<&str> = self.columns.iter().map(|(name, _)| *name).collect();
        format!("SELECT {} FROM {}", columns.join(", "), self.name)
    }

    /// `mark`: how the engine writes the first parameter, `$1` or `?1`, without the number.
    fn insert(&self, mark: char, overriding: &str) -> String {
        let columns: Vec<&str> = self.columns.iter().map(|(name, _)| *name).collect();
        let marks: Vec<String> = (1..=columns.len()).map(|at| format!("{mark}{at}")).collect();
        format!("INSERT INTO {} ({}){overriding} VALUES ({})", self.name, columns.join(", "), marks.join(", "))
    }
}

/// One value.
enum Cell {
    Integer(Option<i64>),
    Real(Option<f64>),
    Text(Option<String>),
    Bytes(Option<Vec<u8>>),
    Id(Option<Uuid>),
    Flag(Option<bool>),
}

/// Both kinds of rows decode the same types of values, but sqlx has no trait for both.
macro_rules! cells {
    ($name:ident, $row:ty) => {
        fn $name(row: &$row, table: &Table) -> Result<Vec<Cell>, sqlx::Error> {
            let cell = |(at, (_, kind)): (usize, &(&str, Kind))| {
                Ok(match kind {
                    Integer => Cell::Integer(row.try_get(at)?),
                    Real => Cell::Real(row.try_get(at)?),
                    Text => Cell::Text(row.try_get(at)?),
                    Bytes => Cell::Bytes(row.try_get(at)?),
                    Id => Cell::Id(row.try_get(at)?),
                    Flag => Cell::Flag(row.try_get(at)?),
                })
            };
            table.columns.iter().enumerate().map(cell).collect()
        }
    };
}
cells!(of_postgres, PgRow);
cells!(of_sqlite, SqliteRow);

macro_rules! binding {
    ($name:ident, $query:ty) => {
        fn $name<'q>(query: $query, cell: Cell) -> $query {
            match cell {
                Cell::Integer(value) => query.bind(value),
                Cell::Real(value) => query.bind(value),
                Cell::Text(value) => query.bind(value),
                Cell::Bytes(value) => query.bind(value),
                Cell::Id(value) => query.bind(value),
                Cell::Flag(value) => query.bind(value),
            }
        }
    };
}
binding!(to_postgres, Query<'q, Postgres, PgArguments>);
binding!(to_sqlite, Query<'q, Sqlite, sqlx::sqlite::SqliteArguments>);

/// Copies all rows of a Postgres database into an empty SQLite database. Both are within a transaction of the caller.
pub(in crate::store) async fn from_postgres(from: &mut PgConnection, to: &mut SqliteConnection) -> StoreResult<()> {
    for table in OF_NEW {
        sqlx::query(AssertSqlSafe(format!("DELETE FROM {table}"))).execute(&mut *to).await?;
    }
    for table in &TABLES {
        let insert = table.insert('?', "");
        let mut rows = sqlx::query(AssertSqlSafe(table.select())).fetch(&mut *from);
        while let Some(row) = rows.try_next().await? {
            let query = sqlx::query(AssertSqlSafe(insert.clone()));
            of_postgres(&row, table)?.into_iter().fold(query, to_sqlite).execute(&mut *to).await?;
        }
    }
    Ok(())
}

/// Copies all rows of a SQLite database into an empty Postgres database. Both are within a transaction of the caller.
pub(in crate::store) async fn to_postgres_from(from: &mut SqliteConnection, to: &mut PgConnection) -> StoreResult<()> {
    for table in OF_NEW {
        sqlx::query(AssertSqlSafe(format!("DELETE FROM {table}"))).execute(&mut *to).await?;
    }
    for table in &TABLES {
        let insert = table.insert('$', if table.is_numbered { " OVERRIDING SYSTEM VALUE" } else { "" });
        let mut rows = sqlx::query(AssertSqlSafe(table.select())).fetch(&mut *from);
        while let Some(row) = rows.try_next().await? {
            let query = sqlx::query(AssertSqlSafe(insert.clone()));
            of_sqlite(&row, table)?.into_iter().fold(query, to_postgres).execute(&mut *to).await?;
        }
        drop(rows);
        if table.is_numbered {
            // the next row gets the number after the last
            let name = table.name;
            let next = format!("SELECT setval(pg_get_serial_sequence('{name}', 'seq'), max(seq)) FROM {name}");
            sqlx::query(AssertSqlSafe(next)).execute(&mut *to).await?;
        }
    }
    Ok(())
}

/// Names of the tables that have rows. Those are not counted in which a new database has rows too.
pub(in crate::store) async fn filled_tables(of: &mut PgConnection) -> StoreResult<Vec<&'static str>> {
    let mut filled = Vec::new();
    for table in TABLES.iter().filter(|table| !OF_NEW.contains(&table.name)) {
        let any = format!("SELECT EXISTS (SELECT 1 FROM {})", table.name);
        if sqlx::query_scalar::<_, bool>(AssertSqlSafe(any)).fetch_one(&mut *of).await? {
            filled.push(table.name);
        }
    }
    Ok(filled)
}
