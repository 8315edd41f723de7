//! Starts the service of the demo; a small HTTP client of it.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde_json::Value;
use tokio_util::io::ReaderStream;

use crate::{cli::serve::Service, settings::Settings};

/// Starts the service on this port; without one on its default port, or on a free port if that is in use.
pub(super) async fn start_service(data_dir: PathBuf, port: Option<u16>) -> Result<Service> {
    let settings = Settings { data_dir, ..Settings::default() };
    let at = |port: u16| Settings { listen: format!("127.0.0.1:{port}"), ..settings.clone() };
    if let Some(port) = port {
        return Service::start(&at(port)).await.with_context(|| format!("--port {port}"));
    }
    match Service::start(&settings).await {
        Ok(service) => Ok(service),
        Err(_) => Service::start(&at(0)).await,
    }
}

/// A line per page of the service: those of the results first.
pub(super) fn pages(url: &str, results: &[(&str, &str)]) -> String {
    let all = results.iter().chain(&[("everything", ""), ("the guide", "guide"), ("the API", "docs")]);
    let lines: Vec<String> = all.map(|(what, path)| format!("  {what:12} {url}/{path}")).collect();
    lines.join("\n")
}

/// A client of one server. Its methods fail when the server does not answer with 2xx, with the detail of the problem.
pub(super) struct Client {
    base: String,
    http: reqwest::Client,
}

impl Client {
    /// A client of the server at `base` (`http://host:port`).
    pub(super) fn new(base: String) -> Self {
        Self { base, http: reqwest::Client::new() }
    }

    /// Uploads a zip to `path` and waits for the job to end.
    pub(super) async fn run_job(&self, path: &str, zip: &Path) -> Result<Value> {
        let (_, location) = self.upload(path, zip).await?;
        let location = location.context("the server accepted the upload without a Location header")?;
        self.wait_for(&location).await
    }

    /// Uploads a zip to `path`. Returns the answer and its header `Location`.
    pub(super) async fn upload(&self, path: &str, zip: &Path) -> Result<(Value, Option<String>)> {
        let file = tokio::fs::File::open(zip).await.with_context(|| format!("cannot read {}", zip.display()))?;
        let length = file.metadata().await?.len();
        let answer = self
            .http
            .post(format!("{}{path}", self.base))
            .header("content-type", "application/zip")
            .header("content-length", length)
            .body(reqwest::Body::wrap_stream(ReaderStream::with_capacity(file, 1 << 20)))
            .send()
            .await
            .with_context(|| format!("POST {path}"))?;
        let location = answer.headers().get("location").and_then(|l| l.to_str().ok()).map(str::to_owned);
        Ok((json(answer).await?, location))
    }

    /// Waits until a job ends, which ends its events, then fetches it. One that does not succeed is an error.
    pub(super) async fn wait_for(&self, location: &str) -> Result<Value> {
        self.get_bytes(&format!("{location}/events")).await?;
        let job = self.get_json(location).await?;
        if job["state"] != "succeeded" {
            let why = job["error"]["detail"].as_str().unwrap_or("no reason was given");
            bail!("the job at {location} ended as {}: {why}", job["state"]);
        }
        Ok(job)
    }

    /// PUTs JSON.
    pub(super) async fn put_json(&self, path: &str, body: &Value) -> Result<Value> {
        json(self.http.put(format!("{}{path}", self.base)).json(body).send().await?).await
    }

    /// POSTs bytes and returns the bytes of the answer.
    pub(super) async fn post_bytes(&self, path: &str, body: Vec<u8>) -> Result<Vec<u8>> {
        let answer = self.http.post(format!("{}{path}", self.base)).body(body).send().await?;
        Ok(answer.error_for_status().with_context(|| format!("POST {path}"))?.bytes().await?.to_vec())
    }

    /// GETs JSON.
    pub(super) async fn get_json(&self, path: &str) -> Result<Value> {
        json(self.http.get(format!("{}{path}", self.base)).send().await?).await
    }

    /// GETs bytes.
    pub(super) async fn get_bytes(&self, path: &str) -> Result<Vec<u8>> {
        let answer = self.http.get(format!("{}{path}", self.base)).send().await?;
        Ok(answer.error_for_status().with_context(|| format!("GET {path}"))?.bytes().await?.to_vec())
    }
}

/// The JSON of an answer; the detail of the problem if it is an error.
async fn json(answer: reqwest::Response) -> Result<Value> {
    let (status, url) = (answer.status(), answer.url().path().to_owned());
    let body: Value = answer.json().await.with_context(|| format!("{url} did not answer with JSON"))?;
    if !status.is_success() {
        bail!("{url} answered {status}: {}", body["detail"].as_str().unwrap_or("no reason was given"));
    }
    Ok(body)
}
