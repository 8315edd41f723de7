//! Migrations: how the schema of an engine is made, and why a database is refused.

use anyhow::anyhow;
use sqlx::{
    SqlSafeStr,
    migrate::{MigrateError, Migration, MigrationType, Migrator},
};

use crate::store::StoreError;

/// The migrations of an engine, in order: version, name, statements. A published one is never edited.
///
/// Versions before the first are those of programs before the first release. They are not used again, so that a
/// database of such a program is recognised.
pub(in crate::store) struct Schema(pub(in crate::store) &'static [(i64, &'static str, &'static str)]);

impl Schema {
    /// The oldest version that can be migrated.
    pub(in crate::store) fn oldest(&self) -> i64 {
        self.0.first().map_or(0, |(version, ..)| *version)
    }

    /// The version that this program writes.
    pub(in crate::store) fn newest(&self) -> i64 {
        self.0.last().map_or(0, |(version, ..)| *version)
    }

    pub(in crate::store) fn migrator(&self) -> Migrator {
        let migrations = self.0.iter().map(|(version, name, sql)| {
            Migration::new(*version, (*name).into(), MigrationType::Simple, sql.into_sql_str(), false)
        });
        Migrator::with_migrations(migrations.collect())
    }

    /// Why the database at `place` was not migrated.
    pub(in crate::store) fn refusal(&self, error: MigrateError, place: &str) -> StoreError {
        match error {
            MigrateError::VersionMissing(version) if version < self.oldest() => anyhow!("{place} {UNRELEASED}"),
            MigrateError::VersionMissing(version) => anyhow!(
                "{place} was migrated by a newer version of pinstack (to schema {version}); run that version or a later one"
            ),
            error => anyhow!(error).context(format!("{place} cannot be migrated")),
        }
        .into()
    }
}

/// What is wrong with a database of a program before the first release, and what to do.
pub(in crate::store) const UNRELEASED: &str = "was made by a version of pinstack from before the first release, and cannot be migrated; use a new one. To keep its \
     profiles, run that version, read them (GET /v1/profiles/RIG/LENS), and send them to the new server (POST \
     /v1/profiles/RIG/LENS/import)";
