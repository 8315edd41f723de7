//! The conformance suite on Postgres, and what is specific to Postgres.

use std::sync::Arc;

use async_trait::async_trait;
use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};

use super::{DatabaseUrl, PostgresMetadata, test_server};
use crate::store::{
    Attempt, Clock, JobFilter, Leases, ManualClock, MetadataStore, PageRequest, StoreResult,
    conformance::{self, Fresh, database::Database},
    rows::transfer,
    sqlite::SqliteMetadata,
};

/// A URL with a schema of its own.
async fn fresh_url() -> DatabaseUrl {
    let server = test_server::url();
    let (url, schema) = test_server::in_schema(server);
    let mut connection = PgConnection::connect(server).await.expect("the server for tests");
    connection.execute(AssertSqlSafe(format!("CREATE SCHEMA {schema}"))).await.expect("a schema");
    DatabaseUrl::new(url)
}

async fn open(url: &DatabaseUrl) -> PostgresMetadata {
    PostgresMetadata::open(url).await.expect("open")
}

#[async_trait]
impl Database for DatabaseUrl {
    async fn open(&self, clock: Arc<dyn Clock>) -> StoreResult<Arc<dyn MetadataStore>> {
        Ok(Arc::new(PostgresMetadata::open_with_clock(self, clock).await?))
    }

    async fn execute(&self, sql: &'static str) -> Result<Vec<String>, sqlx::Error> {
        let mut connection = PgConnection::connect_with(&self.options().expect("a URL")).await?;
        sqlx::query_scalar(sql).fetch_all(&mut connection).await
    }
}

async fn fresh() -> ((), Fresh) {
    let database = Arc::new(fresh_url().await);
    let clock = Arc::new(ManualClock::default());
    let metadata = database.open(clock.clone()).await.expect("open");
    ((), Fresh { metadata, clock, database })
}

crate::metadata_conformance!(crate::store::postgres::tests::fresh, "needs postgresql");

/// A row that is cancelled and to be deleted would stay for ever, with its zip.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn a_deletion_while_the_job_is_released_is_not_forgotten() {
    let url = fresh_url().await;
    let store = Arc::new(open(&url).await);
    conformance::accept(&*store, &conformance::stack()).await;
    let job = conformance::claim(&*store).await.expect("a job waits");
    let mut deletion = store.write().await.expect("a transaction");
    sqlx::query("UPDATE jobs SET cancel_requested = true, delete_requested = true WHERE id = $1")
        .bind(job.id)
        .execute(&mut *deletion)
        .await
        .expect("requested");
    let releasing = {
        let (store, id, token) = (Arc::clone(&store), job.id, job.lease_token);
        tokio::spawn(async move { store.release(id, token, Attempt::NotCounted).await })
    };
    // the release waits for the row
    loop {
        let waiting: i64 = sqlx::query_scalar(
            "SELECT count(*) FROM pg_locks WHERE NOT granted AND locktype IN ('transactionid', 'tuple')",
        )
        .fetch_one(&mut *deletion)
        .await
        .expect("counted");
        if waiting > 0 {
            break;
        }
        tokio::task::yield_now().await;
    }
    deletion.commit().await.expect("committed");
    assert!(releasing.await.expect("no panic").expect("released"));
    let rows: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs").fetch_one(&store.pool).await.expect("counted");
    assert_eq!(rows, 0, "the job is deleted");
    store.close().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn a_change_is_announced_to_another_process() {
    let url = fresh_url().await;
    let (one, two) = (open(&url).await, open(&url).await);
    let (mut heard, mut arrivals) = (two.changes(), two.arrivals());
    let id = conformance::accept(&one, &conformance::stack()).await.id;
    assert_eq!(heard.recv().await.unwrap(), id);
    arrivals.recv().await.expect("its workers hear of a job that waits");
    let mut own = one.changes();
    conformance::claim(&one).await.expect("a job waits");
    assert_eq!((heard.recv().await.unwrap(), own.recv().await.unwrap()), (id, id));
    assert!(arrivals.try_recv().is_err(), "a claim leaves no work for others");
    // a process hears its own notification too, and announces the change once
    let next = conformance::accept(&two, &conformance::stack()).await.id;
    assert_eq!(own.recv().await.unwrap(), next);
}

#[tokio::test]
#[ignore = "needs postgresql"]
async fn a_lease_is_granted_by_the_clock_of_the_database() {
    let url = fresh_url().await;
    let store = open(&url).await;
    conformance::accept(&store, &conformance::stack()).await;
    let claimed = conformance::claim(&store).await.unwrap();
    let ahead: i64 = sqlx::query_scalar(
        "SELECT lease_until - floor(extract(epoch FROM clock_timestamp()) * 1000)::bigint FROM jobs WHERE id = $1",
    )
    .bind(claimed.id)
    .fetch_one(&store.pool)
    .await
    .unwrap();
    let lease = i64::try_from(conformance::LEASE.as_millis()).unwrap();
    assert!((1..=lease).contains(&ahead), "{ahead} ms");
}

/// Fills every table.
async fn filled(store: &PostgresMetadata) {
    conformance::put(store, "rig", "lens", 1.5).await;
    conformance::put(store, "rig", "lens", 2.5).await;
    for _ in 0..3 {
        conformance::accept(store, &conformance::stack()).await;
    }
    conformance::claim(store).await.expect("a job");
    let all = [
        "INSERT INTO scans (name, rig, lens, body, version, owner, created_at, updated_at)
         VALUES ('bee', 'rig', 'lens', '{\"rig\": \"rig\", \"lens\": \"lens\"}', 3, gen_random_uuid(), 5, 6)",
        "INSERT INTO uploads (id, length, received, digest, metadata, wanted, created_at, expires_at)
         VALUES (gen_random_uuid(), 10, 3, '\\x00ff27', 'rig cg==', 1, 7, 8)",
        "INSERT INTO tokens (id, name, digest, scopes, created_at, quota_bytes)
         VALUES (gen_random_uuid(), 'lab', sha256('x'), 'read', 9, 1000)",
        "INSERT INTO notes (id, scan, text, author, created_at)
         VALUES (gen_random_uuid(), 'bee', 'left \u{1f41e}', 'lab', 12)",
        "INSERT INTO clock_gaps (at_ms, gap_ms) VALUES (10, 11)",
        "DELETE FROM jobs WHERE seq = (SELECT max(seq) FROM jobs)",
        "UPDATE jobs SET fraction = 0.1, error = 'K\u{e4}fer \u{1f41e} \"', owner = gen_random_uuid()",
    ];
    for sql in all {
        sqlx::query(AssertSqlSafe(sql)).execute(&store.pool).await.expect(sql);
    }
}

/// All rows of all tables, as text.
async fn dump(store: &PostgresMetadata) -> Vec<String> {
    let mut all = Vec::new();
    for table in &transfer::TABLES {
        let columns: Vec<_> = table.columns.iter().map(|(name, _)| format!("{name}::text")).collect();
        let select = format!("SELECT concat_ws('|', {}) FROM {} ORDER BY 1", columns.join(", "), table.name);
        let rows: Vec<String> = sqlx::query_scalar(AssertSqlSafe(select)).fetch_all(&store.pool).await.unwrap();
        assert!(!rows.is_empty() || table.name == "clock_seen", "{} has no row", table.name);
        all.extend(rows);
    }
    all
}

#[tokio::test]
#[ignore = "needs postgresql"]
async fn all_rows_go_to_a_file_and_into_another_database() {
    let (one, two) = (fresh_url().await, fresh_url().await);
    let (one, two) = (open(&one).await, open(&two).await);
    filled(&one).await;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("copy.sqlite");
    one.snapshot_to(&file).await.expect("a copy");
    assert!(one.snapshot_to(&file).await.is_err(), "a file that exists is not replaced");
    // the file is a database of its own
    let copy = SqliteMetadata::open(&file).await.unwrap();
    let jobs = async |store: &dyn MetadataStore| {
        store.jobs(&JobFilter::default(), &PageRequest { limit: 10, cursor: None }).await.unwrap().items
    };
    assert_eq!(jobs(&copy).await, jobs(&one).await);
    assert_eq!(copy.integrity_errors().await.unwrap(), Vec::<String>::new());
    copy.close().await;
    two.fill_from(&file).await.expect("it is empty");
    assert_eq!(dump(&two).await, dump(&one).await);
    // numbers go on after the last
    let last = jobs(&two).await.len();
    let next = conformance::accept(&two, &conformance::stack()).await;
    assert_eq!(jobs(&two).await.first().map(|job| job.id), Some(next.id));
    assert_eq!(jobs(&two).await.len(), last + 1);
    let refused = two.fill_from(&file).await.expect_err("it has rows").to_string();
    assert!(refused.contains("has rows already") && refused.contains("jobs"), "{refused}");
}

#[tokio::test]
#[ignore = "needs postgresql"]
async fn every_column_of_both_schemas_is_transferred() {
    let url = fresh_url().await;
    let store = open(&url).await;
    let of_schema: Vec<(String, String)> = sqlx::query_as(
        "SELECT table_name::text, column_name::text FROM information_schema.columns
         WHERE table_schema = current_schema() AND table_name NOT IN ('_sqlx_migrations', 'store')",
    )
    .fetch_all(&store.pool)
    .await
    .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let sqlite = SqliteMetadata::open(folder.path().join("a.sqlite")).await.unwrap();
    let of_file: Vec<(String, String)> = sqlx::query_as(
        "SELECT m.name, c.name FROM sqlite_master m JOIN pragma_table_info(m.name) c
         WHERE m.type = 'table' AND m.name NOT LIKE 'sqlite\\_%' ESCAPE '\\' AND m.name <> '_sqlx_migrations'",
    )
    .fetch_all(&mut *sqlite.write().await.unwrap())
    .await
    .unwrap();
    let sorted = |mut pairs: Vec<(String, String)>| {
        pairs.sort();
        pairs
    };
    let listed = transfer::TABLES
        .iter()
        .flat_map(|table| table.columns.iter().map(|(column, _)| (table.name.to_owned(), (*column).to_owned())));
    let listed = sorted(listed.collect());
    assert_eq!(sorted(of_schema), listed);
    assert_eq!(sorted(of_file), listed);
}
