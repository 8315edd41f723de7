//! A server for one test, and helpers for its clients.

use std::{io::Write, sync::Arc, time::Duration};

use pinstack::{
    contract::{
        Fault,
        options::HeightMode,
        outcome::{Artifact, CalibrationOutcome, HeightInfo, ImageInfo, JobOutcome, StackOutcome},
        request::JobRequest,
    },
    http::{self, App, Policy},
    store::{self, Finish, Job, MetadataStore, SpoolFile, Store, blobs::result_key, gc},
};
use pinstack_science::{
    fusion::height::axis::{HeightDirection, HeightUnit},
    imaging::{Raster, codec},
    types::{Warning, WarningCode, metrics::Metrics, report::Grade},
};
use reqwest::{Client, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tempfile::TempDir;
use uuid::Uuid;

/// Size of the slices of most tests, px.
pub const WIDTH: u32 = 24;
pub const HEIGHT: u32 = 18;

const LEASE: Duration = Duration::from_secs(600);

/// A running server with its store.
pub struct TestApp {
    pub base: String,
    pub client: Client,
    pub store: Store,
    pub app: App,
    data: TempDir,
}

impl Drop for TestApp {
    fn drop(&mut self) {
        self.app.shutdown.cancel();
    }
}

impl TestApp {
    pub async fn start() -> Self {
        Self::start_with(|_| {}).await
    }

    pub async fn start_with(change: impl FnOnce(&mut Policy)) -> Self {
        let data = TempDir::new().expect("a folder");
        let store = store::open(data.path()).await.expect("a store");
        let mut policy = Policy { min_free_bytes: 0, ..Policy::default() };
        change(&mut policy);
        let app = App::new(store.clone(), policy);
        let base = serve(app.clone()).await;
        let client = Client::builder().no_proxy().build().expect("a client");
        Self { base, client, store, app, data }
    }

    /// The base URL of a second server on the same store that asks for tokens.
    pub async fn asking_for_tokens(&self) -> String {
        let policy = Policy { auth_required: true, ..(*self.app.policy).clone() };
        let mut app = self.app.clone();
        app.policy = Arc::new(policy);
        serve(app).await
    }

    /// The base URL of a second server on the same store, for which no byte of the disk is free.
    pub async fn on_a_full_disk(&self) -> String {
        let policy = Policy { min_free_bytes: u64::MAX, ..(*self.app.policy).clone() };
        let mut app = App::new(self.store.clone(), policy);
        app.shutdown = self.app.shutdown.clone();
        serve(app).await
    }

    /// The metadata as another process on the same machine has opened it: its changes are not announced to this one.
    pub async fn metadata_of_another_process(&self) -> Arc<dyn MetadataStore> {
        store::open_metadata(self.data.path()).await.expect("the metadata")
    }

    /// The bytes of a blob; `None` when it does not exist.
    pub async fn blob(&self, key: &str) -> Option<Vec<u8>> {
        let blob = self.store.blobs.fetch(key, &self.store.workspace).await.expect("fetched")?;
        Some(std::fs::read(blob.path()).expect("the file can be read"))
    }

    /// Stores bytes as a blob.
    pub async fn put_blob(&self, key: &str, bytes: &[u8]) {
        let path = self.store.workspace.new_path("test").expect("a path");
        std::fs::write(&path, bytes).expect("the workspace can be written");
        self.store.blobs.put(key, SpoolFile::temporary(path)).await.expect("stored");
    }

    /// The jobs that have blobs.
    pub async fn jobs_with_blobs(&self) -> Vec<Uuid> {
        gc::jobs_with_blobs(&*self.store.blobs).await.expect("listed").into_keys().collect()
    }

    pub fn get(&self, path: &str) -> RequestBuilder {
        self.client.get(format!("{}{path}", self.base))
    }

    pub fn post(&self, path: &str) -> RequestBuilder {
        self.client.post(format!("{}{path}", self.base))
    }

    pub fn put(&self, path: &str) -> RequestBuilder {
        self.client.put(format!("{}{path}", self.base))
    }

    pub fn delete(&self, path: &str) -> RequestBuilder {
        self.client.delete(format!("{}{path}", self.base))
    }

    /// Stores a profile `rig/lens` for `slices` slices of the usual size.
    pub async fn with_profile(&self, slices: usize) {
        let answer = self.put("/v1/profiles/rig/lens").json(&profile(slices)).send().await.expect("an answer");
        assert!(answer.status().is_success(), "{}", answer.text().await.unwrap_or_default());
    }

    /// Creates a scan of `rig` and `lens`.
    pub async fn with_scan(&self, name: &str) {
        let scan = json!({ "rig": "rig", "lens": "lens" });
        let answer = self.put(&format!("/v1/scans/{name}")).json(&scan).send().await.expect("an answer");
        assert!(answer.status().is_success(), "{}", answer.text().await.unwrap_or_default());
    }

    /// Sends a stack of two slices with back light for `rig/lens`. Returns its JSON.
    pub async fn with_stack(&self, options: &str) -> Value {
        self.with_profile(2).await;
        let request = self.post(&format!("/v1/stacks?rig=rig&lens=lens{options}")).body(stack_zip(2, 2));
        let answer = request.send().await.expect("an answer");
        assert_eq!(answer.status(), StatusCode::ACCEPTED);
        answer.json().await.expect("JSON")
    }

    /// Claims the next job, like a worker.
    pub async fn claim(&self) -> Job {
        self.store.metadata.claim(LEASE, 3, None).await.expect("the rows answer").expect("a job waits")
    }

    /// Finishes a job with made-up results, like a worker.
    pub async fn finish(&self, job: &Job) {
        let outcome = match &job.request {
            JobRequest::Stack(request) => {
                JobOutcome::Stack(self.stack_outcome(job, !request.layout.back.is_empty()).await)
            }
            JobRequest::Calibration(_) => JobOutcome::Calibration(CalibrationOutcome {
                artifacts: vec![
                    self.artifact(job, "overlay-0", png(WIDTH, HEIGHT, 3, 1)).await,
                    self.artifact(job, "overlay-1", png(WIDTH, HEIGHT, 3, 2)).await,
                ],
                profile_revision: Some(1),
                profile_digest: Some("0".repeat(64)),
                profile_optics_digest: Some("1".repeat(64)),
                reference_index: 1,
                slices: Vec::new(),
                dot_pitch_px: Some(12.5),
                magnification: None,
                verdict: "good".into(),
                grade: Some(Grade::Good),
            }),
            JobRequest::Reconstruction(_) => panic!("a test runs its own program for reconstructions"),
        };
        let finish = Finish::Succeeded { outcome: Box::new(outcome), warnings: Vec::new(), profile: None };
        assert!(self.store.metadata.finish(job.id, job.lease_token, &finish).await.expect("the rows answer"));
    }

    /// Finishes a stack with results that the test changes, like a worker.
    pub async fn finish_stack(&self, job: &Job, change: impl FnOnce(&mut StackOutcome)) {
        let mut outcome = self.stack_outcome(job, true).await;
        change(&mut outcome);
        let outcome = Box::new(JobOutcome::Stack(outcome));
        let finish = Finish::Succeeded { outcome, warnings: Vec::new(), profile: None };
        assert!(self.store.metadata.finish(job.id, job.lease_token, &finish).await.expect("the rows answer"));
    }

    /// Finishes a stack with warnings of these codes.
    pub async fn finish_warned(&self, job: &Job, codes: &[&str]) {
        let outcome = Box::new(JobOutcome::Stack(self.stack_outcome(job, true).await));
        let warning = |code: &&str| Warning::new(WarningCode::from((*code).to_owned()), format!("sentence of {code}"));
        let warnings = codes.iter().map(warning).collect();
        let finish = Finish::Succeeded { outcome, warnings, profile: None };
        assert!(self.store.metadata.finish(job.id, job.lease_token, &finish).await.expect("the rows answer"));
    }

    /// Fails a job, like a worker.
    pub async fn fail(&self, job: &Job, fault: Fault) {
        assert!(
            self.store.metadata.finish(job.id, job.lease_token, &Finish::Failed(fault)).await.expect("the rows answer")
        );
    }

    async fn stack_outcome(&self, job: &Job, has_back_light: bool) -> StackOutcome {
        let mut artifacts = vec![
            self.artifact(job, "image", png(WIDTH, HEIGHT, 4, 3)).await,
            self.artifact(job, "depth", png(WIDTH, HEIGHT, 1, 4)).await,
            self.artifact(job, "preview", png(8, 6, 3, 5)).await,
        ];
        if has_back_light {
            artifacts.push(self.artifact(job, "mask", png(WIDTH, HEIGHT, 1, 6)).await);
            artifacts.push(self.artifact(job, "backlight", png(WIDTH, HEIGHT, 1, 7)).await);
        }
        let image = ImageInfo { width: WIDTH, height: HEIGHT, bit_depth: 8, crop_offset_px: [0, 0], intrinsics: None };
        let height = self.heights(job, &mut artifacts).await;
        let software = Some("pinstack test".into());
        StackOutcome { artifacts, image, height, metrics: Metrics::default(), software }
    }

    /// Adds the files of a height map, if the stack asks for one.
    async fn heights(&self, job: &Job, artifacts: &mut Vec<Artifact>) -> Option<HeightInfo> {
        let JobRequest::Stack(request) = &job.request else { return None };
        if request.options.height == HeightMode::None {
            return None;
        }
        artifacts.push(self.artifact(job, "height", png(WIDTH, HEIGHT, 1, 8)).await);
        artifacts.push(self.artifact(job, "height-sigma", png(WIDTH, HEIGHT, 1, 9)).await);
        Some(HeightInfo {
            unit: HeightUnit::Mm,
            direction: HeightDirection::TowardsCamera,
            offset: -2.5,
            scale: 1e-4,
            invalid: 0,
            median_sigma: Some(0.01),
            valid_fraction: 0.9,
        })
    }

    async fn artifact(&self, job: &Job, name: &str, bytes: Vec<u8>) -> Artifact {
        let key = result_key(job.id, job.lease_token, &format!("{name}.png"));
        self.put_blob(&key, &bytes).await;
        let sha256 = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        Artifact {
            name: name.into(),
            key,
            media_type: "image/png".into(),
            bytes: bytes.len() as u64,
            sha256,
            crc32: None,
        }
    }

    /// Size of the file of an upload, synced or not; 0 without a file.
    pub fn partial_bytes(&self, id: Uuid) -> u64 {
        let path = self.data.path().join("partial").join(format!("{id}.part"));
        path.metadata().map(|m| m.len()).unwrap_or(0)
    }

    /// Files in the spool folder.
    pub fn spooled(&self) -> usize {
        std::fs::read_dir(self.store.workspace.path()).expect("the spool can be read").count()
    }
}

/// Starts a server and returns its base URL.
async fn serve(app: App) -> String {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let base = format!("http://{}", listener.local_addr().expect("an address"));
    tokio::spawn(http::serve(app, listener));
    base
}

/// Body of `PUT /v1/profiles/...`: nearly identical slices.
pub fn profile(slices: usize) -> Value {
    let homographies: Vec<Value> = (0..slices)
        .map(|i| {
            let scale = 1.0 + i as f64 * 0.001;
            json!([scale, 0, 0, 0, scale, 0, 0, 0, 1])
        })
        .collect();
    json!({ "image_width": WIDTH, "image_height": HEIGHT, "reference_index": 0, "homographies": homographies })
}

/// A PNG with a pattern.
pub fn png(width: u32, height: u32, channels: usize, seed: usize) -> Vec<u8> {
    let (width, height) = (width as usize, height as usize);
    let samples = (0..width * height * channels).map(|i| ((i * 37 + seed * 101) % 251) as u8).collect();
    let mut out = Vec::new();
    let raster = Raster::eight(width, height, channels, samples);
    codec::encode_png(&mut out, &raster, &codec::Metadata::default()).expect("a PNG");
    out
}

/// A zip of members.
pub fn zip(members: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in members {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).expect("a member");
        zip.write_all(bytes).expect("a member");
    }
    zip.finish().expect("a zip").into_inner()
}

/// A zip of a stack of the usual size.
pub fn stack_zip(front: usize, back: usize) -> Vec<u8> {
    let light = |folder: &'static str, count: usize| {
        (0..count).map(move |i| (format!("{folder}/img_{i}.png"), png(WIDTH, HEIGHT, 3, i)))
    };
    zip(&light("front", front).chain(light("back", back)).collect::<Vec<_>>())
}

/// Checks that a response is a problem with this status and code, and returns it.
pub async fn problem(answer: Response, status: u16, code: &str) -> Value {
    let told = answer.status().as_u16();
    let kind = answer.headers().get("content-type").and_then(|v| v.to_str().ok()).unwrap_or_default().to_owned();
    assert!(answer.headers().contains_key("x-request-id"), "every answer has a request id");
    let path = answer.url().path().to_owned();
    let text = answer.text().await.expect("a body");
    assert_eq!((told, kind.as_str()), (status, "application/problem+json"), "{text}");
    let problem: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(problem["code"], code, "{text}");
    assert_eq!(problem["status"], status, "{text}");
    assert_eq!(problem["type"], format!("/problems/{code}"), "{text}");
    assert_eq!(problem["instance"], path, "{text}");
    assert!(problem["title"].as_str().is_some_and(|t| !t.is_empty()), "{text}");
    assert!(problem["detail"].as_str().is_some_and(|t| !t.is_empty()), "{text}");
    problem
}

/// The id in the JSON of a job.
pub fn id(job: &Value) -> Uuid {
    job["id"].as_str().and_then(|id| id.parse().ok()).expect("a job has an id")
}
