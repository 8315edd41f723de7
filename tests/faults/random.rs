//! Faults in random order while clients send stacks all the time. Every request must be answered, and after the last
//! fault every accepted stack ends within a minute, with the bytes that it always has.
//!
//! `PINSTACK_TEST_FAULTS` sets how long faults come, in seconds. The seed of their order is printed, and
//! `PINSTACK_TEST_FAULTS_SEED` sets it.

use std::{
    path::PathBuf,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
    time::{Duration, Instant},
};

use futures::future::join_all;
use reqwest::{Client, RequestBuilder, StatusCode};
use serde_json::Value;

use crate::{
    input::{profile, zip},
    relay::{Mood, Moody, Relay, Target},
    service::{LOOK, Service, command, verified},
    site::Site,
    small_disk::{Ballast, SmallDisk},
};

const CLIENTS: usize = 3;
/// Default of `PINSTACK_TEST_FAULTS`.
const SECONDS: u64 = 8;
/// Longest time from the end of the last fault to the end of the last stack: a minute, and the pause of a minute before
/// the third attempt of a stack.
const RECOVERY: Duration = Duration::from_secs(120);
/// Most stacks that are kept; the others are deleted, so that the disk stays small.
const KEPT: usize = 12;
/// Longest fault, and longest time between two.
const LONGEST_FAULT: Duration = Duration::from_secs(5);
/// Most requests during a fault, and between two.
const REQUESTS: u64 = 40;

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().expect("a number"))
}

/// Random numbers (xorshift).
struct Random(u64);

impl Random {
    fn start() -> Self {
        let now = || std::time::SystemTime::UNIX_EPOCH.elapsed().expect("after 1970").as_nanos() as u64;
        let seed = number("PINSTACK_TEST_FAULTS_SEED").unwrap_or_else(now).max(1);
        println!("PINSTACK_TEST_FAULTS_SEED={seed}");
        Self(seed)
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// The clients of one service.
struct Load {
    client: Client,
    url: String,
    zip: Vec<u8>,
    answered: AtomicUsize,
    kept: AtomicUsize,
    failed: AtomicUsize,
    /// No fault comes any more, and no stack is sent.
    is_over: AtomicBool,
}

impl Load {
    async fn on(service: &Service) -> Self {
        let client = Client::builder().no_proxy().timeout(Duration::from_secs(120)).build().expect("a client");
        let [answered, kept, failed] = Default::default();
        let url = service.url.clone();
        let put = client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile()).send().await;
        assert_eq!(put.expect("an answer").status(), StatusCode::CREATED);
        Self { client, url, zip: zip(), answered, kept, failed, is_over: AtomicBool::new(false) }
    }

    /// Repeats a request until it is not refused because of a fault. Each time it is answered with a status.
    async fn ask(&self, make: impl Fn() -> RequestBuilder) -> (StatusCode, reqwest::Response) {
        loop {
            let answer = make().send().await.unwrap_or_else(|error| panic!("a request was not answered: {error:?}"));
            self.answered.fetch_add(1, Ordering::Relaxed);
            let status = answer.status();
            if !status.is_server_error() {
                return (status, answer);
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    async fn get(&self, path: &str) -> reqwest::Response {
        let (status, answer) = self.ask(|| self.client.get(format!("{}{path}", self.url))).await;
        assert_eq!(status, StatusCode::OK, "{path}: what was accepted is there");
        answer
    }

    /// Sends a stack, waits for its end, and deletes some: the image, if it succeeded.
    async fn one_stack(&self, key: &str) -> Option<Vec<u8>> {
        let post = || {
            let post = self.client.post(format!("{}/v1/stacks?rig=rig&lens=lens", self.url));
            post.header("idempotency-key", key).body(self.zip.clone())
        };
        let (status, answer) = self.ask(post).await;
        assert_eq!(status, StatusCode::ACCEPTED);
        let path = answer.headers()["location"].to_str().expect("a path").to_owned();
        let stack = loop {
            let stack: Value = self.get(&path).await.json().await.expect("JSON");
            if ["succeeded", "failed"].iter().any(|state| stack["state"] == *state) {
                break stack;
            }
            tokio::time::sleep(LOOK).await;
        };
        let image = if stack["state"] == "succeeded" {
            Some(self.get(&format!("{path}/image")).await.bytes().await.expect("an image").to_vec())
        } else {
            // the machine failed it three times
            let is_of_machine =
                ["insufficient_storage", "unavailable"].iter().any(|code| stack["error"]["code"] == *code);
            assert!(is_of_machine, "{stack}");
            self.failed.fetch_add(1, Ordering::Relaxed);
            None
        };
        if self.kept.fetch_add(1, Ordering::Relaxed) >= KEPT {
            self.kept.fetch_sub(1, Ordering::Relaxed);
            let (status, _) = self.ask(|| self.client.delete(format!("{}{path}", self.url))).await;
            assert!([StatusCode::NO_CONTENT, StatusCode::NOT_FOUND].contains(&status), "{status}");
        }
        image
    }

    /// One client, until it is over: the images of its stacks.
    async fn client(&self, number: usize) -> Vec<Vec<u8>> {
        let mut images = Vec::new();
        let mut i = 0;
        while !self.is_over.load(Ordering::Relaxed) {
            images.extend(self.one_stack(&format!("{number}-{i}")).await);
            i += 1;
        }
        images
    }

    /// Waits until so many requests more are answered. While the network is cut, none may be.
    async fn answers(&self, more: u64) {
        let (begun, until) = (Instant::now(), self.answered.load(Ordering::Relaxed) + more as usize);
        while self.answered.load(Ordering::Relaxed) < until && begun.elapsed() < LONGEST_FAULT {
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Runs the clients while faults come. `fault` begins one of the faults by its number, and ends the one before.
    async fn survive(&self, kinds: u64, mut fault: impl FnMut(Option<u64>)) {
        let mut random = Random::start();
        let end = Instant::now() + Duration::from_secs(number("PINSTACK_TEST_FAULTS").unwrap_or(SECONDS));
        let mut count = 0;
        let faults = async {
            while Instant::now() < end {
                fault(Some(random.below(kinds)));
                count += 1;
                self.answers(1 + random.below(REQUESTS)).await;
                fault(None);
                self.answers(1 + random.below(REQUESTS)).await;
            }
            self.is_over.store(true, Ordering::Relaxed);
        };
        let (clients, ended) = (join_all((0..CLIENTS).map(|number| self.client(number))), AtomicBool::new(false));
        let clients = async {
            let images: Vec<Vec<u8>> = clients.await.into_iter().flatten().collect();
            ended.store(true, Ordering::Relaxed);
            images
        };
        let recovery = async {
            faults.await;
            let last = Instant::now();
            while !ended.load(Ordering::Relaxed) {
                assert!(last.elapsed() < RECOVERY, "a stack has not ended two minutes after the last fault");
                tokio::time::sleep(LOOK).await;
            }
        };
        let (images, ()) = tokio::join!(clients, recovery);
        assert!(!images.is_empty() && images.iter().all(|image| *image == images[0]), "the same bytes each time");
        // a stack that is sent now is fused as if nothing had happened
        assert_eq!(self.one_stack("last").await.as_ref(), images.first());
        let listed: Value = self.get("/v1/stacks?limit=500").await.json().await.expect("JSON");
        let kept = self.kept.load(Ordering::Relaxed);
        assert_eq!(listed["items"].as_array().map(Vec::len), Some(kept), "each accepted stack once: {listed}");
        let ready = self.get("/readyz").await.json::<Value>().await.expect("JSON");
        assert_eq!(ready["ready"], true, "{ready}");
        let failed = self.failed.load(Ordering::Relaxed);
        println!("{count} faults, {} stacks fused, {failed} failed by the machine", images.len());
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs the right to mount a file system"]
async fn random_faults_of_disk_and_log_lose_no_stack() {
    let (disk, log_disk) = (SmallDisk::mount(128), SmallDisk::mount(1));
    let folder = tempfile::TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    std::fs::create_dir(disk.data()).expect("a folder");
    std::os::unix::fs::symlink(disk.data(), &data).expect("a link");
    let log = std::fs::File::create(log_disk.path().join("log")).expect("a log");
    let service = Service::start_with_log(&data, log, None, &["--log", "debug"]).await.expect("it listens");
    let load = Load::on(&service).await;
    let mut ballast: Vec<Ballast> = Vec::new();
    load.survive(4, |fault| match fault {
        Some(0) => ballast.push(disk.fill_except(0)),
        // enough for rows, or for a part of what a job writes
        Some(1) => ballast.push(disk.fill_except(256 << 10)),
        Some(2) => ballast.push(log_disk.fill_except(0)),
        Some(_) => ballast.extend([disk.fill_except(0), log_disk.fill_except(0)]),
        None => ballast.drain(..).for_each(Ballast::remove),
    })
    .await;
    service.stop().await;
    verified(|arguments| command(&data, arguments));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn random_faults_of_database_and_bucket_lose_no_stack() {
    let site = Site::fresh().await;
    // the database is on a socket of this machine
    let (path, rest) = site.database.split_once("host=").expect("a socket").1.split_once('&').expect("options");
    let database = Relay::to(Target::Unix(PathBuf::from(path).join(".s.PGSQL.5432"))).await;
    let bucket = Moody::before(&site.endpoint).await;
    let remote = format!("postgres://postgres@{}/postgres?{rest}", database.address);
    let settings = site.settings("all", &remote, &bucket.url);
    let api = site.api("api", &settings).await;
    let worker = site.worker("worker", &settings, None);
    let load = Load::on(&api).await;
    load.survive(3, |fault| match fault {
        Some(0) => database.cut(),
        Some(1) => bucket.becomes(Mood::Failing),
        Some(_) => {
            database.cut();
            bucket.becomes(Mood::Failing);
        }
        None => {
            database.mend();
            bucket.becomes(Mood::Good);
        }
    })
    .await;
    worker.stop().await;
    api.stop().await;
    site.verify(&settings);
}
