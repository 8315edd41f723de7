//! Several processes on one Postgres database and one folder, as on several machines: two that serve the API, and two
//! that run jobs.

use std::path::PathBuf;

use reqwest::StatusCode;
use rustix::process::Signal;
use serde_json::Value;
use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};
use tempfile::TempDir;

use crate::{
    input::{profile, zip},
    service::{LOOK, Service, command, command_on, text, verified},
    test_server::{Server, in_schema, url},
};

/// Two API processes, and what workers need to join them.
struct Site {
    folder: TempDir,
    database: String,
    apis: [Service; 2],
    client: reqwest::Client,
}

impl Site {
    async fn start(server: &str) -> Self {
        let (database, schema) = in_schema(server);
        let mut connection = PgConnection::connect(server).await.expect("the server for tests");
        connection.execute(AssertSqlSafe(format!("CREATE SCHEMA {schema}"))).await.expect("a schema");
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        let api = async || {
            Service::start(&data, None, &["--workers", "0", "--database-url", &database]).await.expect("it listens")
        };
        // both at once: one migrates the database
        let (one, two) = tokio::join!(api(), api());
        let client = reqwest::Client::builder().no_proxy().build().expect("a client");
        client.put(format!("{}/v1/profiles/rig/lens", one.url)).json(&profile()).send().await.expect("a profile");
        Self { folder, database, apis: [one, two], client }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn worker(&self, fault: Option<&str>) -> Service {
        Service::start_worker(&self.data(), fault, &["--database-url", &self.database])
    }

    /// Waits until so many processes have started: each listens to the notifications of the database.
    async fn until_all_listen(&self, processes: i64) {
        let mut connection = PgConnection::connect(&self.database).await.expect("the server for tests");
        let count = "SELECT count(*) FROM pg_stat_activity WHERE query LIKE 'LISTEN%'";
        while sqlx::query_scalar::<_, i64>(count).fetch_one(&mut connection).await.expect("a number") < processes {
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Sends a stack until it is accepted, with one key. `None`: the answer was an error, or none came.
    async fn try_post(&self, api: usize, key: &str) -> Option<String> {
        let url = format!("{}/v1/stacks?rig=rig&lens=lens", self.apis[api].url);
        let sent = self.client.post(url).header("Idempotency-Key", key).body(zip()).send().await.ok()?;
        let accepted = [StatusCode::ACCEPTED, StatusCode::OK].contains(&sent.status());
        accepted.then(|| sent.headers()["location"].to_str().expect("a path").to_owned())
    }

    async fn post(&self, api: usize, key: &str) -> String {
        loop {
            if let Some(stack) = self.try_post(api, key).await {
                return stack;
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    async fn get(&self, api: usize, path: &str) -> Option<Value> {
        let answer = self.client.get(format!("{}{path}", self.apis[api].url)).send().await.ok()?;
        if !answer.status().is_success() {
            return None;
        }
        answer.json().await.ok()
    }

    /// Waits for the end of a stack.
    async fn ended(&self, api: usize, stack: &str) -> Value {
        loop {
            let shown = self.get(api, stack).await.unwrap_or_default();
            if ["succeeded", "failed", "cancelled"].iter().any(|state| shown["state"] == **state) {
                return shown;
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Nothing is left over, and every file is what its row says.
    fn verify(&self) {
        verified(|arguments| command_on(&self.database, &self.data(), arguments));
    }

    async fn stop(self) {
        for api in self.apis {
            api.stop().await;
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn a_worker_that_is_stopped_beyond_its_lease_publishes_nothing_when_it_continues() {
    let site = Site::start(url()).await;
    let mut sleeper = site.worker(Some("artifact.make=1*return(stop)->off"));
    let stack = site.post(0, "a").await;
    while !sleeper.is_stopped() {
        tokio::time::sleep(LOOK).await;
    }
    let other = site.worker(None);
    let ended = site.ended(1, &stack).await;
    assert_eq!((ended["state"].as_str(), ended["attempt"].as_u64()), (Some("succeeded"), Some(2)), "{ended}");
    sleeper.signal(Signal::CONT);
    sleeper.signal(Signal::TERM);
    assert!(sleeper.ended().await.success(), "it continues, observes that it lost the lease, and ends normally");
    for api in [0, 1] {
        assert_eq!(site.get(api, &stack).await.as_ref(), Some(&ended), "the stopped worker published nothing");
    }
    other.stop().await;
    site.verify();
    site.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn the_job_of_a_worker_that_was_killed_is_done_by_another_once() {
    let site = Site::start(url()).await;
    // before its results are published, and after that is committed
    for (key, fault, attempts) in [
        ("a", "publish.rename=1*return(kill)->off", 2),
        ("b", "rows.finish=1*return(kill)->off", 2),
        ("c", "rows.finish=1*off->1*return(kill)->off", 1),
    ] {
        let mut victim = site.worker(Some(fault));
        let stack = site.post(0, key).await;
        assert!(!victim.ended().await.success(), "{fault}");
        let other = site.worker(None);
        let ended = site.ended(1, &stack).await;
        assert_eq!(
            (ended["state"].as_str(), ended["attempt"].as_u64()),
            (Some("succeeded"), Some(attempts)),
            "{fault}"
        );
        assert_eq!(site.post(1, key).await, stack, "a repeat at the other process finds the first");
        // a worker that is stopped before it has started ends by the signal: the next stack shows that it has
        let next = site.post(0, &format!("after {key}")).await;
        assert_eq!(site.ended(1, &next).await["state"], "succeeded");
        assert_eq!(site.get(1, &stack).await.as_ref(), Some(&ended), "{fault}: nothing was done again");
        other.stop().await;
        site.verify();
    }
    let listed = site.get(1, "/v1/stacks").await.expect("a list");
    assert_eq!(listed["items"].as_array().map(Vec::len), Some(6), "{listed}");
    site.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn a_restart_of_postgres_loses_no_stack_and_does_none_twice() {
    const STACKS: usize = 30;
    const RESTARTS: usize = 5;
    let server = Server::private();
    let site = Site::start(&server.url).await;
    let workers = [site.worker(None), site.worker(None)];
    // a process that finds no database when it starts ends, and its supervisor starts it again
    site.until_all_listen(4).await;
    let mut stacks = Vec::new();
    for i in 0..STACKS {
        // in the midst of acceptances, jobs and heartbeats: more often than a job has attempts
        if i % (STACKS / RESTARTS) == 1 {
            server.restart();
        }
        stacks.push(site.post(i % 2, &format!("key {i}")).await);
    }
    for stack in &stacks {
        let ended = site.ended(0, stack).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
    let listed = site.get(1, "/v1/stacks?limit=500").await.expect("a list");
    assert_eq!(listed["items"].as_array().map(Vec::len), Some(STACKS), "one stack per key");
    for worker in workers {
        worker.stop().await;
    }
    site.verify();
    site.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql"]
async fn commands_work_on_postgres() {
    let site = Site::start(url()).await;
    let run = |arguments: &[&str]| command_on(&site.database, &site.data(), arguments);
    let added = run(&["token", "add", "ann", "--scope", "read"]);
    assert!(added.status.success(), "{}", text(&added));
    assert!(text(&run(&["token", "list"])).contains("ann\tread"));
    let told = text(&run(&["doctor"]));
    assert!(told.contains("1 profiles, 0 queued jobs") && told.contains("clock: agrees"), "{told}");
    // the same from a file, as a container gets a secret
    let (secret, settings) = (site.folder.path().join("url"), site.folder.path().join("pinstack.toml"));
    std::fs::write(&secret, format!("{}\n", site.database)).expect("a file");
    std::fs::write(&settings, format!("database_url_file = {:?}\n", secret.display().to_string())).expect("a file");
    let listed = command(&site.data(), &["token", "list", "--config", settings.to_str().expect("UTF-8")]);
    assert!(text(&listed).contains("ann\tread"), "{}", text(&listed));
    let asked = site.client.get(format!("{}/v1/stacks", site.apis[1].url)).send().await.expect("an answer");
    assert_eq!(asked.status(), StatusCode::UNAUTHORIZED, "the token holds for every process");
    let wrong = command_on("postgres://ann:geheim@127.0.0.1:1/none", &site.data(), &["gc"]);
    let said = text(&wrong);
    assert!(!wrong.status.success() && said.contains("none at 127.0.0.1:1") && !said.contains("geheim"), "{said}");
    site.stop().await;
}
