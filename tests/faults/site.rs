//! An empty database and an empty bucket for several processes, as on several machines.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use reqwest::{Client, StatusCode};
use serde_json::Value;
use sqlx::{AssertSqlSafe, Connection, Executor, PgConnection};
use tempfile::TempDir;

use crate::{
    service::{LOOK, Service, command, verified},
    test_bucket, test_server,
};

/// Answers by which a service says that its storage is away; a client tries again.
pub const AWAY: [StatusCode; 2] = [StatusCode::SERVICE_UNAVAILABLE, StatusCode::INTERNAL_SERVER_ERROR];

/// An empty database and an empty bucket.
pub struct Site {
    pub folder: TempDir,
    pub database: String,
    pub bucket: String,
    /// Address of the bucket.
    pub endpoint: String,
    pub client: Client,
}

impl Site {
    /// On the servers of all tests.
    pub async fn fresh() -> Self {
        Self::on(test_server::url()).await
    }

    /// The same on a Postgres server of the caller.
    pub async fn on(postgres: &str) -> Self {
        let s3 = test_bucket::server();
        let (database, schema) = test_server::in_schema(postgres);
        let mut connection = PgConnection::connect(postgres).await.expect("the server for tests");
        connection.execute(AssertSqlSafe(format!("CREATE SCHEMA {schema}"))).await.expect("a schema");
        let folder = TempDir::new().expect("a folder");
        std::fs::write(folder.path().join("key"), test_bucket::credentials()).expect("a file");
        let client = Client::builder().no_proxy().timeout(Duration::from_secs(120)).build().expect("a client");
        Self { folder, database, bucket: s3.bucket(), endpoint: s3.endpoint.clone(), client }
    }

    /// A settings file, with the database and the bucket at these addresses.
    pub fn settings(&self, name: &str, database: &str, endpoint: &str) -> PathBuf {
        let file = self.folder.path().join(format!("{name}.toml"));
        let text = format!(
            "database_url = {database:?}\nstorage_url = \"s3://{}/lab\"\nstorage_endpoint = {endpoint:?}\n\
             storage_credentials_file = {:?}\n",
            self.bucket,
            self.folder.path().join("key").display().to_string()
        );
        std::fs::write(&file, text).expect("a file");
        file
    }

    /// The folder of a process: none shares it.
    pub fn data(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub async fn api(&self, name: &str, settings: &Path) -> Service {
        let flags = ["--workers", "0", "--config", settings.to_str().expect("UTF-8")];
        Service::start(&self.data(name), None, &flags).await.expect("it listens")
    }

    pub fn worker(&self, name: &str, settings: &Path, fault: Option<&str>) -> Service {
        Service::start_worker(&self.data(name), fault, &["--config", settings.to_str().expect("UTF-8")])
    }

    pub async fn put_profile(&self, api: &Service, profile: &Value) {
        let put = self.client.put(format!("{}/v1/profiles/rig/lens", api.url)).json(profile).send().await;
        assert!(put.expect("an answer").status().is_success());
    }

    /// Sends a stack once. `Err`: the status and the text of the answer.
    pub async fn try_post(&self, api: &Service, key: &str, zip: &[u8]) -> Result<String, (StatusCode, String)> {
        let url = format!("{}/v1/stacks?rig=rig&lens=lens", api.url);
        let sent = self.client.post(url).header("Idempotency-Key", key).body(zip.to_vec()).send().await;
        let answer = sent.expect("the service answers");
        match answer.status() {
            StatusCode::ACCEPTED => Ok(answer.headers()["location"].to_str().expect("a path").to_owned()),
            status => Err((status, answer.text().await.expect("a text"))),
        }
    }

    /// Sends a stack until it is accepted.
    pub async fn post(&self, api: &Service, key: &str, zip: &[u8]) -> String {
        loop {
            match self.try_post(api, key, zip).await {
                Ok(stack) => return stack,
                Err((status, text)) => assert!(AWAY.contains(&status), "{status}: {text}"),
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    pub async fn shown(&self, api: &Service, path: &str) -> Value {
        let answer = self.client.get(format!("{}{path}", api.url)).send().await.expect("an answer");
        answer.json().await.expect("JSON")
    }

    pub async fn until(&self, api: &Service, stack: &str, states: &[&str]) -> Value {
        loop {
            let shown = self.shown(api, stack).await;
            if states.iter().any(|state| shown["state"] == **state) {
                return shown;
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Waits for a stack that must succeed.
    pub async fn succeeded(&self, api: &Service, stack: &str) -> Value {
        let ended = self.until(api, stack, &["succeeded", "failed", "cancelled"]).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
        ended
    }

    pub async fn image(&self, api: &Service, stack: &str) -> Vec<u8> {
        let answer = self.client.get(format!("{}{stack}/image", api.url)).send().await.expect("an answer");
        assert_eq!(answer.status(), StatusCode::OK);
        answer.bytes().await.expect("an image").to_vec()
    }

    /// Nothing is left over, and every file is what its row says.
    pub fn verify(&self, settings: &Path) {
        let settings = settings.to_str().expect("UTF-8");
        verified(|arguments| command(&self.data("operator"), &[arguments, &["--config", settings]].concat()));
    }
}
