//! A client of the service that remembers what was acknowledged to it. When the service dies, it repeats its request,
//! as clients do, and verifies that everything acknowledged still holds.

mod calibrations;
mod notes;
mod uploads;

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use reqwest::{Client, RequestBuilder, StatusCode, header::HeaderMap};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use crate::{
    input::{profile, scan_zip, zip},
    service::{LOOK, Service, command, verified},
};

/// Why a request failed.
#[derive(Debug)]
pub enum Broken {
    /// The service died during it; another one is running now.
    Died,
    /// It was refused because the disk is full.
    Refused,
}

type Told<T> = Result<T, Broken>;

pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or(Value::Null)
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default()
    }
}

/// A client and its service.
pub struct Story {
    folder: TempDir,
    service: Option<Service>,
    client: Client,
    /// Deaths of the service and refusals so far.
    pub broke: Vec<String>,
    /// Faults of the processes that are started after the next deaths, the last first.
    faults: Vec<String>,
    zip: Vec<u8>,
    flags: &'static [&'static str],
    /// Settings file of the service and of the commands that look after it.
    settings: Option<PathBuf>,
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

impl Story {
    /// Starts a service with armed failpoints.
    pub async fn begin(fault: &str) -> Self {
        Self::begin_with(&[fault.to_owned()], None).await
    }

    /// The same with a settings file, and with faults for the processes that are started after deaths: one each, and
    /// none after the last.
    pub async fn begin_with(faults: &[String], settings: Option<PathBuf>) -> Self {
        Self::in_folder(TempDir::new().expect("a folder"), faults, &[], settings).await
    }

    async fn in_folder(
        folder: TempDir,
        faults: &[String],
        flags: &'static [&'static str],
        settings: Option<PathBuf>,
    ) -> Self {
        let client = Client::builder().no_proxy().pool_max_idle_per_host(0).build().expect("a client");
        let faults = faults.iter().rev().cloned().collect();
        let mut story = Self { folder, service: None, client, broke: Vec::new(), faults, zip: zip(), flags, settings };
        story.start().await;
        story
    }

    /// A client with a service on an existing data folder, without faults.
    pub async fn on(data: &Path) -> Self {
        Self::on_with(data, &[]).await
    }

    /// The same, with more flags.
    pub async fn on_with(data: &Path, flags: &'static [&'static str]) -> Self {
        let folder = TempDir::new().expect("a folder");
        std::os::unix::fs::symlink(data, folder.path().join("data")).expect("a link");
        Self::in_folder(folder, &[], flags, None).await
    }

    /// The same, with the rows in Postgres.
    pub async fn on_database(data: &Path, database: &str) -> Self {
        let flags = vec!["--database-url".to_owned(), database.to_owned()];
        let flags: Vec<&'static str> = flags.into_iter().map(|flag| &*flag.leak()).collect();
        Self::on_with(data, flags.leak()).await
    }

    /// Address of the service.
    pub fn url(&self) -> &str {
        &self.service.as_ref().expect("it runs").url
    }

    pub fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn flags(&self) -> Vec<&str> {
        let settings = self.settings.as_deref().and_then(Path::to_str);
        self.flags.iter().copied().chain(settings.into_iter().flat_map(|file| ["--config", file])).collect()
    }

    /// Starts a service with the next fault; when that ends it before it listens, another one.
    async fn start(&mut self) {
        loop {
            let fault = self.faults.pop();
            self.service = Service::start(&self.data(), fault.as_deref(), &self.flags()).await;
            if self.service.is_some() {
                return;
            }
            assert!(fault.is_some(), "a service without a fault starts; its log:\n{}", self.log());
            self.broke.push("it died before it listened".into());
        }
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(self.data().with_extension("log")).unwrap_or_default()
    }

    /// One request. When the service dies during it, another one is started.
    async fn send(&mut self, make: impl FnOnce(&Client, &str) -> RequestBuilder) -> Told<Answer> {
        let url = self.service.as_ref().expect("it runs").url.clone();
        let sent = make(&self.client, &url).timeout(Duration::from_secs(60)).send().await;
        let answer = match sent {
            Ok(answer) => {
                let (status, headers) = (answer.status(), answer.headers().clone());
                answer.bytes().await.map(|body| Answer { status, headers, body: body.to_vec() })
            }
            Err(error) => Err(error),
        };
        match answer {
            Ok(answer) if answer.status == StatusCode::INSUFFICIENT_STORAGE => {
                let problem = answer.json();
                // the response to HEAD has no body
                assert!(problem.is_null() || problem["code"] == "insufficient_storage", "{problem}");
                self.broke.push(problem["detail"].to_string());
                Err(Broken::Refused)
            }
            Ok(answer) => {
                assert_ne!(answer.status, StatusCode::INTERNAL_SERVER_ERROR, "{}\n{}", answer.json(), self.log());
                Ok(answer)
            }
            Err(error) => {
                let ended =
                    tokio::time::timeout(Duration::from_secs(20), self.service.as_mut().expect("it ran").ended());
                assert!(ended.await.is_ok(), "the service lives, but a request failed: {error:?}\n{}", self.log());
                self.broke.push("it died under a request".into());
                self.start().await;
                Err(Broken::Died)
            }
        }
    }

    async fn get(&mut self, path: &str) -> Told<Answer> {
        self.send(|client, url| client.get(format!("{url}{path}")).header("prefer", "wait=5")).await
    }

    /// Stores a profile for the slices.
    pub async fn profile(&mut self) -> Told<()> {
        self.put_profile(&profile()).await
    }

    /// Stores a profile. It may have been stored before without acknowledgement.
    pub async fn put_profile(&mut self, profile: &Value) -> Told<()> {
        let path = "/v1/profiles/rig/lens";
        let put = self
            .send(|client, url| client.put(format!("{url}{path}")).header("if-none-match", "*").json(profile))
            .await?;
        assert!([StatusCode::CREATED, StatusCode::PRECONDITION_FAILED].contains(&put.status), "{}", put.json());
        assert_eq!(self.get(path).await?.json()["revision"], 1);
        Ok(())
    }

    /// Sends a stack in one request with an idempotency key: its path.
    pub async fn post(&mut self, key: &str) -> Told<String> {
        let zip = self.zip.clone();
        let posted = self
            .send(|client, url| {
                client.post(format!("{url}/v1/stacks?rig=rig&lens=lens")).header("idempotency-key", key).body(zip)
            })
            .await?;
        assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.json());
        Ok(posted.header("location").to_owned())
    }

    /// Creates the scan `bee`.
    pub async fn scan(&mut self) -> Told<()> {
        let scan = json!({ "rig": "rig", "lens": "lens" });
        let put = self.send(|client, url| client.put(format!("{url}/v1/scans/bee")).json(&scan)).await?;
        assert!([StatusCode::CREATED, StatusCode::OK].contains(&put.status), "{}", put.json());
        Ok(())
    }

    /// Sends the scan in one zip with an idempotency key: the paths of its stacks.
    pub async fn archive(&mut self, key: &str) -> Told<Vec<String>> {
        let posted = self
            .send(|client, url| {
                let archive = client.post(format!("{url}/v1/scans/bee/archive")).header("idempotency-key", key);
                archive.body(scan_zip())
            })
            .await?;
        assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.json());
        let views = posted.json()["views"].take();
        let views = views.as_array().cloned().unwrap_or_default();
        Ok(views.iter().filter_map(|view| view["stack"].as_str().map(str::to_owned)).collect())
    }

    /// Reruns a stack with an idempotency key: the path of the new one.
    pub async fn rerun(&mut self, path: &str, key: &str) -> Told<String> {
        let posted =
            self.send(|client, url| client.post(format!("{url}{path}/rerun")).header("idempotency-key", key)).await?;
        assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.json());
        Ok(posted.header("location").to_owned())
    }

    /// Downloads the zip of a stack, which must be the one that was sent.
    pub async fn upload(&mut self, path: &str) -> Told<()> {
        let upload = self.get(&format!("{path}/upload")).await?;
        assert_eq!((upload.status, &upload.body), (StatusCode::OK, &self.zip), "the zip is stored completely");
        Ok(())
    }

    /// Sends these stacks from now on.
    pub fn sends(&mut self, zip: Vec<u8>) {
        self.zip = zip;
    }

    /// Downloads the image as a TIFF, which the service converts.
    pub async fn converted(&mut self, path: &str) -> Told<()> {
        let image =
            self.send(|client, url| client.get(format!("{url}{path}/image")).header("accept", "image/tiff")).await?;
        assert_eq!((image.status, image.header("content-type")), (StatusCode::OK, "image/tiff"), "{}", image.json());
        Ok(())
    }

    /// A stack that is refused because the disk is full, with or without a declared length: the detail of the refusal.
    pub async fn refused(&mut self, path: &str, streamed: bool) -> String {
        let chunks = futures::stream::iter([Ok::<_, std::io::Error>(self.zip.clone())]);
        let body = if streamed { reqwest::Body::wrap_stream(chunks) } else { self.zip.clone().into() };
        let answer = self.send(|client, url| client.post(format!("{url}{path}")).body(body)).await;
        assert!(matches!(answer, Err(Broken::Refused)), "the disk is full");
        self.broke.last().cloned().unwrap_or_default()
    }

    /// A stack as it is now.
    pub async fn shown(&mut self, path: &str) -> Value {
        let answer = self.send(|client, url| client.get(format!("{url}{path}"))).await;
        answer.expect("an answer").json()
    }

    /// Number of stacks.
    pub async fn count(&mut self) -> Told<usize> {
        let list = self.get("/v1/stacks?limit=100").await?.json();
        Ok(list["items"].as_array().expect("a list").len())
    }

    /// Waits for a stack that must succeed: the digest of its image.
    pub async fn image(&mut self, path: &str) -> Told<String> {
        let stack = self.ended(path).await?;
        assert_eq!(stack["state"], "succeeded", "{stack}\n{}", self.log());
        let image = self.get(&format!("{path}/image")).await?;
        assert_eq!(image.status, StatusCode::OK, "{}", image.json());
        let digest = hex(&Sha256::digest(&image.body));
        assert_eq!(image.header("etag").trim_matches('"'), digest, "a result is whole");
        Ok(digest)
    }

    /// Waits for the end of a stack.
    pub async fn ended(&mut self, path: &str) -> Told<Value> {
        loop {
            let answer = self.get(path).await?;
            let stack = answer.json();
            assert_eq!(answer.status, StatusCode::OK, "an acknowledged stack exists: {stack}");
            if ["succeeded", "failed", "cancelled"].iter().any(|state| stack["state"] == *state) {
                return Ok(stack);
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Requests the cancellation of a stack: true when it was acknowledged.
    pub async fn cancel(&mut self, path: &str) -> Told<bool> {
        let answer = self.send(|client, url| client.post(format!("{url}{path}/cancel"))).await?;
        assert!([StatusCode::ACCEPTED, StatusCode::CONFLICT].contains(&answer.status), "{}", answer.json());
        Ok(answer.status == StatusCode::ACCEPTED)
    }

    /// Deletes something, which an earlier attempt may have deleted.
    pub async fn delete(&mut self, path: &str) -> Told<()> {
        let answer =
            self.send(|client, url| client.delete(format!("{url}{path}")).header("tus-resumable", "1.0.0")).await?;
        assert!([StatusCode::NO_CONTENT, StatusCode::NOT_FOUND].contains(&answer.status), "{}", answer.json());
        let after = self.get(path).await?;
        assert_eq!(after.status, StatusCode::NOT_FOUND, "what was deleted does not exist: {}", after.json());
        Ok(())
    }

    /// Ends the service.
    pub async fn end_without_looking(mut self) {
        self.service.take().expect("it runs").stop().await;
    }

    /// Ends the service, collects garbage, and verifies the store: nothing is missing, nothing is left over.
    pub async fn end(mut self) -> Vec<String> {
        let service = self.service.take().expect("it runs");
        service.stop().await;
        let data = self.data();
        let settings: Vec<&str> =
            self.settings.iter().flat_map(|file| ["--config", file.to_str().expect("UTF-8")]).collect();
        verified(|arguments| command(&data, &[arguments, &settings].concat()));
        let spooled = std::fs::read_dir(data.join("spool")).expect("the spool");
        let left: Vec<_> = spooled.map(|entry| entry.expect("an entry").file_name()).collect();
        assert!(
            left.len() <= 2,
            "the workspaces of dead processes are removed, except that of the last command: {left:?}"
        );
        self.broke
    }
}
