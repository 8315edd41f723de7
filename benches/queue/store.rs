//! Stores for the bench, and jobs to fill them with.

use std::path::Path;

use pinstack::{
    contract::Name,
    store::{
        self, DatabaseUrl, EnqueueAll, MetadataStore, NewJob, Shared, Store,
        conformance::{name, put, stack},
    },
};

use crate::test_server;

/// Rigs that the jobs come from.
pub const RIGS: usize = 100;

/// The URL of an empty schema of the Postgres server.
pub async fn schema() -> String {
    let (url, schema) = test_server::in_schema(test_server::url());
    let pool = sqlx::PgPool::connect(&url).await.expect("Postgres answers");
    let create = sqlx::AssertSqlSafe(format!("CREATE SCHEMA {schema}"));
    sqlx::query(create).execute(&pool).await.expect("a schema");
    pool.close().await;
    url
}

/// A store with a profile for every rig. `None` for the database: SQLite.
pub async fn open(folder: &Path, database: Option<&str>) -> Store {
    let shared = Shared { database: database.map(DatabaseUrl::new), storage: None };
    store::open_shared(folder, &shared).await.expect("a store")
}

/// A profile for every rig.
pub async fn put_profiles(metadata: &dyn MetadataStore) {
    for rig in 0..RIGS {
        put(metadata, &rig_name(rig), "lens", 1.01).await;
    }
}

/// The next of the jobs, of one rig after another.
pub fn job(number: usize) -> NewJob {
    NewJob { rig: name(&rig_name(number % RIGS)), lens: lens(), ..stack() }
}

fn rig_name(rig: usize) -> String {
    format!("rig-{rig}")
}

fn lens() -> Name {
    name("lens")
}

/// Accepts jobs until `depth` of them wait.
pub async fn fill(metadata: &dyn MetadataStore, depth: usize) {
    let waiting = metadata.counts().await.expect("counts").queued as usize;
    let numbers: Vec<usize> = (waiting..depth).collect();
    for batch in numbers.chunks(1000) {
        let jobs: Vec<NewJob> = batch.iter().map(|number| job(*number)).collect();
        let accepted = metadata.enqueue_all(&jobs, u64::MAX).await.expect("enqueue_all");
        assert!(matches!(accepted, EnqueueAll::Accepted(_)), "{accepted:?}");
    }
}
