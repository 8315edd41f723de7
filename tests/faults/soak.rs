//! Many stacks from several clients at once, with cancellations and deletes, while the service is killed repeatedly.
//! `PINSTACK_SOAK` sets the number of stacks, for example 200; the default is smaller.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use futures::future::join_all;
use reqwest::{Client, RequestBuilder, Response, StatusCode};
use rustix::process::Signal;
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;
use tokio::sync::RwLock;

use crate::{
    input::{profile, zip},
    service::{LOOK, Service, command, verified},
};

const CLIENTS: usize = 4;
/// Default number of stacks.
const STACKS: usize = 32;
/// The service is killed after this many accepted stacks, in the first half.
const KILL_EVERY: usize = 5;

/// The state of a stack, as it was acknowledged to its client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    Kept,
    Cancelled,
    Deleted,
}

/// The service and its clients.
struct Site {
    data: PathBuf,
    service: RwLock<Service>,
    client: Client,
    accepted: AtomicUsize,
}

impl Site {
    async fn start(data: &Path) -> Self {
        let service = Service::start(data, None, &[]).await.expect("it listens");
        let client = Client::builder().no_proxy().build().expect("a client");
        Self { data: data.to_owned(), service: RwLock::new(service), client, accepted: AtomicUsize::new(0) }
    }

    /// Repeats a request until there is an answer: the service may be restarting.
    async fn ask(&self, make: impl Fn(&Client, &str) -> RequestBuilder) -> Response {
        loop {
            let url = self.service.read().await.url.clone();
            match make(&self.client, &url).timeout(Duration::from_secs(60)).send().await {
                Ok(answer) if answer.status() != StatusCode::SERVICE_UNAVAILABLE => return answer,
                _ => tokio::time::sleep(LOOK).await,
            }
        }
    }

    async fn shown(&self, path: &str) -> (StatusCode, Value) {
        loop {
            let answer = self.ask(|client, url| client.get(format!("{url}{path}"))).await;
            let status = answer.status();
            // a kill may interrupt the body
            if let Ok(body) = answer.json().await {
                return (status, body);
            }
        }
    }

    async fn kill(&self) {
        let mut service = self.service.write().await;
        service.signal(Signal::KILL);
        service.ended().await;
        *service = Service::start(&self.data, None, &[]).await.expect("it starts again");
    }

    /// One client: sends its stacks, cancels and deletes some.
    async fn client(&self, number: usize, stacks: usize, zip: &[u8]) -> Vec<(String, Fate)> {
        let mut sent = Vec::new();
        for i in 0..stacks {
            let key = format!("{number}-{i}");
            let answer = self
                .ask(|client, url| {
                    let post = client.post(format!("{url}/v1/stacks?rig=rig&lens=lens"));
                    post.header("idempotency-key", &key).body(zip.to_vec())
                })
                .await;
            assert_eq!(answer.status(), StatusCode::ACCEPTED);
            let path = answer.headers()["location"].to_str().expect("a path").to_owned();
            self.accepted.fetch_add(1, Ordering::SeqCst);
            let fate = match (number + i) % 4 {
                1 => {
                    let answer = self.ask(|client, url| client.post(format!("{url}{path}/cancel"))).await;
                    // 409: it had ended before
                    if answer.status() == StatusCode::ACCEPTED { Fate::Cancelled } else { Fate::Kept }
                }
                2 => {
                    let answer = self.ask(|client, url| client.delete(format!("{url}{path}"))).await;
                    // 404: an earlier attempt deleted it and was not acknowledged
                    assert!([StatusCode::NO_CONTENT, StatusCode::NOT_FOUND].contains(&answer.status()));
                    Fate::Deleted
                }
                _ => Fate::Kept,
            };
            sent.push((path, fate));
        }
        sent
    }

    async fn ended(&self, path: &str) -> Value {
        loop {
            let (status, stack) = self.shown(path).await;
            assert_eq!(status, StatusCode::OK, "a stack that was accepted is there: {stack}");
            if ["succeeded", "failed", "cancelled"].iter().any(|state| stack["state"] == *state) {
                return stack;
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    async fn image(&self, path: &str) -> Vec<u8> {
        loop {
            let answer = self.ask(|client, url| client.get(format!("{url}{path}/image"))).await;
            assert_eq!(answer.status(), StatusCode::OK);
            if let Ok(bytes) = answer.bytes().await {
                return Sha256::digest(&bytes).to_vec();
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_stack_is_accounted_for_after_cancels_deletes_and_kills() {
    let stacks = std::env::var("PINSTACK_SOAK").ok().and_then(|text| text.parse().ok()).unwrap_or(STACKS);
    let folder = TempDir::new().expect("a folder");
    let site = Arc::new(Site::start(&folder.path().join("data")).await);
    site.ask(|client, url| client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile())).await;
    let zip = zip();

    let killer = Arc::clone(&site);
    let kills = tokio::spawn(async move {
        let mut kills = 0;
        for after in (KILL_EVERY..stacks / 2).step_by(KILL_EVERY) {
            while killer.accepted.load(Ordering::SeqCst) < after {
                tokio::time::sleep(LOOK).await;
            }
            killer.kill().await;
            kills += 1;
        }
        kills
    });
    let clients = (0..CLIENTS).map(|number| site.client(number, stacks / CLIENTS, &zip));
    let fates: Vec<(String, Fate)> = join_all(clients).await.into_iter().flatten().collect();
    let kills = kills.await.expect("the killer did its work");

    let mut images = Vec::new();
    for (path, fate) in &fates {
        match fate {
            Fate::Deleted => assert_eq!(site.shown(path).await.0, StatusCode::NOT_FOUND, "{path}"),
            Fate::Cancelled => assert_eq!(site.ended(path).await["state"], "cancelled", "{path}"),
            Fate::Kept => {
                let stack = site.ended(path).await;
                // a cancellation by a request that was not acknowledged counts too
                if stack["cancel_requested"] != true {
                    assert_eq!(stack["state"], "succeeded", "{stack}");
                    images.push(site.image(path).await);
                }
            }
        }
    }
    assert!(
        images.len() >= stacks / 3 && images.iter().all(|image| *image == images[0]),
        "the same stack gives the same bytes"
    );
    let (_, list) = site.shown("/v1/stacks?limit=500").await;
    let kept = fates.iter().filter(|(_, fate)| *fate != Fate::Deleted).count();
    assert_eq!(list["items"].as_array().map(Vec::len), Some(kept), "each exactly once");

    let descriptors = site.service.read().await.descriptors();
    assert!(descriptors < 100, "{descriptors} files are open while the service is idle");
    println!("{} stacks, {kept} kept, {} fused, {kills} kills, {descriptors} open files", fates.len(), images.len());
    let data = site.data.clone();
    let site = Arc::into_inner(site).expect("all clients have gone");
    site.service.into_inner().stop().await;
    let said = verified(|arguments| command(&data, arguments));
    assert!(said.starts_with(&format!("{kept} jobs")), "{said}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hundred_uploads_at_once_take_little_memory() {
    const UPLOADS: usize = 100;
    const PIECES: usize = 64;
    let folder = TempDir::new().expect("a folder");
    let site = Site::start(&folder.path().join("data")).await;
    site.ask(|client, url| client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile())).await;
    let before = site.service.read().await.peak_memory_kb();
    // 16 MiB each, and no zip: refused once all of it has arrived
    let piece = bytes::Bytes::from(vec![7; 256 << 10]);
    let uploads = (0..UPLOADS).map(|_| {
        let pieces: Vec<_> = (0..PIECES).map(|_| Ok::<_, std::io::Error>(piece.clone())).collect();
        let post = |client: &Client, url: &str| client.post(format!("{url}/v1/stacks?rig=rig&lens=lens"));
        let body = reqwest::Body::wrap_stream(futures::stream::iter(pieces));
        let site = &site;
        async move {
            let url = site.service.read().await.url.clone();
            post(&site.client, &url).body(body).send().await.expect("an answer").status()
        }
    });
    let told = join_all(uploads).await;
    assert!(told.iter().all(|status| *status == StatusCode::UNPROCESSABLE_ENTITY), "{told:?}");
    let grown = site.service.read().await.peak_memory_kb() - before;
    println!("{UPLOADS} uploads of {} MiB at once: {grown} kB", PIECES / 4);
    assert!(grown < 192 << 10, "{grown} kB for {UPLOADS} uploads");
}
