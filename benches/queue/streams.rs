//! What clients that wait cost the database.

use std::time::{Duration, Instant};

use futures::future::join_all;
use pinstack::{
    http::{App, Policy, serve},
    store::{Enqueue, MetadataStore},
};
use sqlx::PgPool;

use crate::store::{job, open, put_profiles, schema};

const STREAMS: [usize; 3] = [0, 100, 500];
/// Time over which transactions are counted.
const COUNTED: Duration = Duration::from_secs(10);

/// Time after which an idle session of Postgres has written its counters.
const SETTLED: Duration = Duration::from_secs(12);

/// Prints the table.
pub async fn run() {
    println!("event streams   transactions per second   ms until all streams know of the end of their job");
    for streams in STREAMS {
        let database = schema().await;
        let folder = tempfile::tempdir().expect("a folder");
        let store = open(folder.path(), Some(&database)).await;
        // the jobs are changed by another process, as by a worker on another machine
        let other = open(folder.path(), Some(&database)).await;
        put_profiles(&*store.metadata).await;
        let policy = Policy {
            max_connections: 2 * streams + 10,
            connections_per_client: Some(2 * streams + 10),
            ..Policy::default()
        };
        let app = App::new(store.clone(), policy);
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        tokio::spawn(serve(app, listener));
        let mut open_streams = Vec::new();
        for number in 0..streams {
            let new = job(number);
            let accepted = store.metadata.enqueue(&new, u64::MAX).await.expect("enqueue");
            assert!(matches!(accepted, Enqueue::Accepted(_)));
            let url = format!("http://{address}/v1/stacks/{}/events", new.id);
            let mut stream = reqwest::get(url).await.expect("an event stream");
            stream.chunk().await.expect("the first event").expect("the state");
            open_streams.push((new.id, stream));
        }
        let pool = PgPool::connect(&database).await.expect("Postgres answers");
        tokio::time::sleep(SETTLED).await;
        let before = transactions(&pool).await;
        tokio::time::sleep(COUNTED).await;
        let rate = (transactions(&pool).await - before) as f64 / COUNTED.as_secs_f64();
        let told = end_all(&*other.metadata, open_streams).await;
        println!("{streams:>13}   {rate:>23.1}   {:.0}", told.as_secs_f64() * 1e3);
        for one in [store, other] {
            one.metadata.close().await;
        }
    }
}

/// Transactions of the database so far.
async fn transactions(pool: &PgPool) -> i64 {
    let mut connection = pool.acquire().await.expect("a connection");
    sqlx::query("SELECT pg_stat_clear_snapshot()").execute(&mut *connection).await.expect("cleared");
    sqlx::query_scalar("SELECT xact_commit FROM pg_stat_database WHERE datname = current_database()")
        .fetch_one(&mut *connection)
        .await
        .expect("the counter")
}

/// Cancels all jobs and waits until every stream has ended.
async fn end_all(metadata: &dyn MetadataStore, streams: Vec<(uuid::Uuid, reqwest::Response)>) -> Duration {
    let begun = Instant::now();
    for (job, _) in &streams {
        metadata.cancel(*job).await.expect("cancel");
    }
    join_all(
        streams
            .into_iter()
            .map(|(_, mut stream)| async move { while stream.chunk().await.expect("events").is_some() {} }),
    )
    .await;
    begun.elapsed()
}
