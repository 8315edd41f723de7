//! The database as a whole: connected, migrated, checked, closed.

use std::{path::Path, sync::Arc, time::Duration};

use anyhow::anyhow;
use async_trait::async_trait;
use sqlx::{PgConnection, postgres::PgPoolOptions};
use tokio::sync::broadcast;
use uuid::Uuid;

use super::{
    engine::{PostgresMetadata, Wall},
    notifications::Notifications,
    options::DatabaseUrl,
    sql::{search::refresh, totals::totals},
};
use crate::store::{
    Clock, MetadataStore, StoreError, StoreResult, SystemClock, Totals,
    failpoint::step,
    rows::{schema::Schema, transaction::Listeners},
};

/// Most connections of a process.
const CONNECTIONS: u32 = 10;
/// How long a request waits for a connection: a server that restarts is back within that time, usually.
const ACQUIRE_TIMEOUT: Duration = Duration::from_secs(10);

pub(in crate::store) const SCHEMA: Schema = Schema(&[
    (5, "rows", include_str!("schema/0005_rows.sql")),
    (6, "service", include_str!("schema/0006_service.sql")),
    (7, "reconstructions", include_str!("schema/0007_reconstructions.sql")),
    (8, "search", include_str!("schema/0008_search.sql")),
    (9, "notes", include_str!("schema/0009_notes.sql")),
    (10, "auto", include_str!("schema/0010_auto.sql")),
]);

impl PostgresMetadata {
    /// Connects and migrates the schema, with the clock of the database.
    ///
    /// # Errors
    /// When the database cannot be reached or written, or a version of the program that knows another
    /// schema migrated it.
    pub async fn open(url: &DatabaseUrl) -> StoreResult<Self> {
        Self::connect(url, Wall::Database, Arc::new(SystemClock)).await
    }

    /// The same with another clock, for tests.
    ///
    /// # Errors
    /// As [`PostgresMetadata::open`].
    pub async fn open_with_clock(url: &DatabaseUrl, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        Self::connect(url, Wall::Given(Arc::clone(&clock)), clock).await
    }

    async fn connect(url: &DatabaseUrl, wall: Wall, clock: Arc<dyn Clock>) -> StoreResult<Self> {
        let pool = PgPoolOptions::new()
            .max_connections(CONNECTIONS)
            .acquire_timeout(ACQUIRE_TIMEOUT)
            .after_connect(|connection, _| Box::pin(make_durable(connection)))
            .connect_with(url.options()?)
            .await
            .map_err(|error| anyhow!(error).context(format!("database_url: cannot connect to {url}")))?;
        step("rows.migrate").map_err(|error| StoreError::of_io(error, "cannot migrate".into()))?;
        // processes that start at once wait for each other: the migrator takes an advisory lock
        let migrated = SCHEMA.migrator().run(&pool).await;
        migrated.map_err(|error| SCHEMA.refusal(error, &format!("database_url: the database {url}")))?;
        let listeners = Listeners::default();
        let notifications = Notifications::start(&pool, listeners.clone()).await?;
        let (observer, last_seen) = Default::default();
        let store = Self { pool, wall, clock, observer, last_seen, listeners, notifications };
        refresh(&store).await?;
        Ok(store)
    }
}

/// A commit that was acknowledged must be on stable storage, also where the database is configured for less.
async fn make_durable(connection: &mut PgConnection) -> Result<(), sqlx::Error> {
    sqlx::query(
        "SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off'",
    )
    .execute(connection)
    .await?;
    Ok(())
}

#[async_trait]
impl MetadataStore for PostgresMetadata {
    fn changes(&self) -> broadcast::Receiver<Uuid> {
        self.listeners.changes.subscribe()
    }

    fn arrivals(&self) -> broadcast::Receiver<()> {
        self.listeners.arrivals.subscribe()
    }

    async fn service_id(&self) -> StoreResult<Uuid> {
        Ok(sqlx::query_scalar("SELECT id FROM service").fetch_one(&self.pool).await?)
    }

    async fn totals(&self) -> StoreResult<Totals> {
        totals(self).await
    }

    async fn integrity_errors(&self) -> StoreResult<Vec<String>> {
        // foreign keys, checks and triggers hold while the database runs
        sqlx::query("SELECT 1").execute(&self.pool).await?;
        Ok(Vec::new())
    }

    async fn healthy(&self) -> bool {
        // fails where the server only reads, as a standby does
        let answer = sqlx::query("UPDATE clock_seen SET at_ms = at_ms").execute(&self.pool);
        matches!(tokio::time::timeout(Duration::from_secs(2), answer).await, Ok(Ok(_)))
    }

    async fn snapshot_to(&self, file: &Path) -> StoreResult<()> {
        self.copy_to(file).await
    }

    async fn close(&self) {
        self.notifications.stop();
        self.pool.close().await;
    }
}
