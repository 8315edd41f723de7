//! The address of the database, which contains its password: nothing shows it.

use std::{fmt, str::FromStr};

use anyhow::Context;
use serde::{Deserialize, Serialize};
use sqlx::postgres::PgConnectOptions;

use crate::store::StoreResult;

/// Longest time of one statement, and of waiting for a lock. Statements are short; one that takes longer waits for a
/// process that hangs.
const STATEMENT_TIMEOUT: &str = "30s";
/// After this time a transaction that does nothing is ended, so that a process that was stopped holds no lock.
const IDLE_TRANSACTION_TIMEOUT: &str = "15s";

/// A URL `postgres://user:password@host:port/database?sslmode=verify-full`. Its text shows neither user nor password.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct DatabaseUrl(String);

impl From<String> for DatabaseUrl {
    fn from(url: String) -> Self {
        Self(url)
    }
}

impl DatabaseUrl {
    /// Wraps a URL; whether it is one is found out by [`DatabaseUrl::options`].
    pub fn new(url: impl Into<String>) -> Self {
        Self(url.into())
    }

    /// True for a URL of Postgres. Says nothing about whether a server answers there.
    pub fn is_valid(&self) -> bool {
        let scheme = self.0.starts_with("postgres://") || self.0.starts_with("postgresql://");
        scheme && PgConnectOptions::from_str(&self.0).is_ok()
    }

    /// How to connect.
    pub(in crate::store) fn options(&self) -> StoreResult<PgConnectOptions> {
        // the cause would repeat the URL
        let options = PgConnectOptions::from_str(&self.0).ok().context(
            "database_url is not a URL of Postgres; it must look like postgres://user:password@host:5432/pinstack",
        )?;
        Ok(options.application_name("pinstack").options([
            ("statement_timeout", STATEMENT_TIMEOUT),
            ("lock_timeout", STATEMENT_TIMEOUT),
            ("idle_in_transaction_session_timeout", IDLE_TRANSACTION_TIMEOUT),
        ]))
    }
}

impl fmt::Display for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Ok(options) = PgConnectOptions::from_str(&self.0) else { return f.write_str("(not a URL of Postgres)") };
        let database = options.get_database().unwrap_or("(the default database)");
        write!(f, "{database} at {}:{}", options.get_host(), options.get_port())
    }
}

impl fmt::Debug for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "DatabaseUrl({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_of_a_url_has_no_password() {
        let url = DatabaseUrl::new("postgres://ann:geheim@db.example:6543/stacks?sslmode=require");
        assert!(url.is_valid());
        assert_eq!(format!("{url} {url:?}"), "stacks at db.example:6543 DatabaseUrl(stacks at db.example:6543)");
    }

    #[test]
    fn what_is_no_url_of_postgres_is_refused_without_repeating_it() {
        for wrong in ["", "geheim", "mysql://ann:geheim@db/stacks", "postgres://ann:geheim@db:port/stacks"] {
            let url = DatabaseUrl::new(wrong);
            assert!(!url.is_valid(), "{wrong}");
            assert!(!format!("{url:?}").contains("geheim"));
        }
        let error = DatabaseUrl::new("postgres://ann:geheim@db:port/stacks").options().expect_err("no port");
        assert!(!format!("{error:?}").contains("geheim"), "{error:?}");
    }
}
