//! A Postgres server that has no free connection, and one that restarts while the files are in a bucket.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::Value;
use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};

use crate::{
    input::{profile, zip},
    service::{LOOK, Service},
    site::Site,
    test_server::Server,
};

/// Connections of the server, those for superusers included.
const CONNECTIONS: usize = 25;

/// Longest time until a request is refused.
const REFUSED: Duration = Duration::from_secs(30);

/// A client that has taken all connections of a server. They are free when its process ends, or before.
struct Greedy(Vec<PgConnection>);

impl Greedy {
    /// Ends the connections of the service, and takes them together with all others, until the service has none.
    async fn takes_all(url: &str) -> Self {
        let mut first = PgConnection::connect(url).await.expect("a connection is free");
        let mut all = Vec::new();
        loop {
            let ended =
                "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE application_name = 'pinstack'";
            let had: i64 = sqlx::query_scalar(ended).fetch_one(&mut first).await.expect("a superuser");
            let refused = loop {
                match PgConnection::connect(url).await {
                    Ok(connection) => all.push(connection),
                    Err(error) => break error,
                }
            };
            let code = refused.as_database_error().and_then(|error| error.code().map(|code| code.into_owned()));
            assert_eq!(code.as_deref(), Some("53300"), "{refused}");
            if had == 0 {
                all.push(first);
                return Self(all);
            }
        }
    }
}

impl Greedy {
    fn frees_all(self) {
        drop(self.0);
    }
}

async fn get(site: &Site, api: &Service, path: &str) -> reqwest::Response {
    site.client.get(format!("{}{path}", api.url)).timeout(REFUSED).send().await.expect("an answer in time")
}

async fn problem(answer: reqwest::Response) -> (u16, String, bool, Value) {
    let retry = answer.headers().get("retry-after").map(|value| value.to_str().expect("a number").to_owned());
    let waits = retry.is_some_and(|seconds| seconds.parse::<u64>().is_ok_and(|seconds| seconds > 0));
    let status = answer.status().as_u16();
    let body: Value = answer.json().await.expect("a problem");
    (status, body["code"].as_str().unwrap_or_default().to_owned(), waits, body)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_database_without_a_free_connection_refuses_for_a_while_and_loses_nothing() {
    let server = Server::private();
    let mut admin = PgConnection::connect(&server.url).await.expect("the server for tests");
    let fewer = format!("ALTER SYSTEM SET max_connections = {CONNECTIONS}");
    admin.execute(AssertSqlSafe(fewer)).await.expect("a superuser");
    drop(admin);
    server.restart();
    let site = Site::on(&server.url).await;
    let settings = site.settings("all", &site.database, &site.endpoint);
    let api = site.api("api", &settings).await;
    site.put_profile(&api, &profile()).await;
    let zip = zip();
    // one job is running when the connections go, and one is waiting
    let worker = site.worker("worker", &settings, Some("artifact.make=1*sleep(20000)->off"));
    let running = site.post(&api, "running", &zip).await;
    let waiting = site.post(&api, "waiting", &zip).await;
    site.until(&api, &running, &["running"]).await;

    let greedy = Greedy::takes_all(&server.url).await;
    let log = site.data("worker").with_extension("log");
    let log = || std::fs::read_to_string(&log).expect("a log");
    assert!(!log().contains("job leaves its worker"), "the job runs still");
    for path in ["/v1/stacks", running.as_str()] {
        let (status, code, waits, body) = problem(get(&site, &api, path).await).await;
        assert_eq!((status, code.as_str(), waits), (503, "unavailable", true), "{path}: {body}");
        let detail = body["detail"].as_str().expect("a sentence");
        assert!(detail.contains("try again later"), "{detail}");
    }
    let (status, text) = site.try_post(&api, "meanwhile", &zip).await.expect_err("it cannot be accepted");
    assert!(status == StatusCode::SERVICE_UNAVAILABLE && text.contains("\"code\":\"unavailable\""), "{status} {text}");
    assert_eq!(get(&site, &api, "/healthz").await.status(), StatusCode::OK, "the process lives");
    assert_eq!(get(&site, &api, "/readyz").await.status(), StatusCode::SERVICE_UNAVAILABLE);
    // the job has ended meanwhile, and its worker cannot write that
    while !log().contains("cannot write the end of a job") {
        tokio::time::sleep(LOOK).await;
    }
    greedy.frees_all();

    while get(&site, &api, "/readyz").await.status() != StatusCode::OK {
        tokio::time::sleep(LOOK).await;
    }
    for stack in [&running, &waiting] {
        let ended = site.succeeded(&api, stack).await;
        assert_eq!(ended["attempt"], 1, "the connections are no fault of the job: {ended}");
    }
    let meanwhile = site.post(&api, "meanwhile", &zip).await;
    site.succeeded(&api, &meanwhile).await;
    let listed = site.shown(&api, "/v1/stacks").await;
    assert_eq!(listed["items"].as_array().map(Vec::len), Some(3), "one stack per key: {listed}");
    worker.stop().await;
    api.stop().await;
    site.verify(&settings);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_restart_of_postgres_while_the_files_are_in_a_bucket_loses_no_stack() {
    const STACKS: usize = 12;
    const RESTARTS: usize = 4;
    let server = Server::private();
    let site = Site::on(&server.url).await;
    let settings = site.settings("all", &site.database, &site.endpoint);
    let api = site.api("api", &settings).await;
    site.put_profile(&api, &profile()).await;
    let workers = [site.worker("worker-1", &settings, None), site.worker("worker-2", &settings, None)];
    let zip = zip();
    // both workers have started: a process that finds no database at its start ends
    let first = site.post(&api, "first", &zip).await;
    site.succeeded(&api, &first).await;
    let mut connection = PgConnection::connect(&site.database).await.expect("the server for tests");
    let count = "SELECT count(*) FROM pg_stat_activity WHERE query LIKE 'LISTEN%'";
    while sqlx::query_scalar::<_, i64>(count).fetch_one(&mut connection).await.expect("a number") < 3 {
        tokio::time::sleep(LOOK).await;
    }
    drop(connection);
    let mut stacks = vec![first];
    for i in 1..STACKS {
        // in the midst of uploads to the bucket, acceptances, jobs and heartbeats
        if i % (STACKS / RESTARTS) == 1 {
            server.restart();
        }
        stacks.push(site.post(&api, &format!("key {i}"), &zip).await);
    }
    let image = site.image(&api, &stacks[0]).await;
    for stack in &stacks {
        site.succeeded(&api, stack).await;
        assert_eq!(site.image(&api, stack).await, image, "the same zip gives the same bytes");
    }
    let listed = site.shown(&api, "/v1/stacks?limit=500").await;
    assert_eq!(listed["items"].as_array().map(Vec::len), Some(STACKS), "one stack per key: {listed}");
    for worker in workers {
        worker.stop().await;
    }
    api.stop().await;
    // what was stored for a request that was not accepted is removed, and nothing else
    site.verify(&settings);
}
