//! A log that cannot be written: its reader went away, its disk is full, or its reader hangs.

use std::{io::PipeReader, process::Stdio};

use reqwest::{Client, StatusCode};
use tempfile::TempDir;

use crate::{
    input::{profile, zip},
    service::{LOOK, Service, command, verified},
};

/// What standard error is.
#[derive(Debug, Clone, Copy)]
enum Sink {
    ClosedPipe,
    FullDisk,
    HangingReader,
}

impl Sink {
    /// It, and what must live as long as the process.
    fn open(self) -> (Stdio, Option<PipeReader>) {
        if matches!(self, Self::FullDisk) {
            let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
            return (full.into(), None);
        }
        let (reader, writer) = std::io::pipe().expect("a pipe");
        (writer.into(), matches!(self, Self::HangingReader).then_some(reader))
    }
}

async fn lost_lines(client: &Client, url: &str) -> f64 {
    let metrics = client.get(format!("{url}/metrics")).send().await.expect("an answer").text().await.expect("a text");
    let line = metrics.lines().find_map(|line| line.strip_prefix("pinstack_log_lines_lost_total "));
    line.expect("the series").parse().expect("a number")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_log_that_cannot_be_written_stops_neither_requests_nor_jobs() {
    for sink in [Sink::ClosedPipe, Sink::FullDisk, Sink::HangingReader] {
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        let ((log, _reader), (log_of_worker, _other)) = (sink.open(), sink.open());
        let api = Service::start_with_log(&data, log, None, &["--workers", "0", "--log", "trace"]).await;
        let api = api.expect("it listens");
        let worker = Service::start_worker_with_log(&data, log_of_worker, None, &["--log", "trace"]);
        let (client, url) = (Client::builder().no_proxy().build().expect("a client"), &api.url);
        let put = client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile()).send().await.expect("an answer");
        assert_eq!(put.status(), StatusCode::CREATED, "{sink:?}");
        // until the pipe and the queue of lines are full
        while lost_lines(&client, url).await == 0.0 {
            let listed = client.get(format!("{url}/v1/stacks")).send().await.expect("an answer");
            assert_eq!(listed.status(), StatusCode::OK, "{sink:?}");
        }
        let posted = client.post(format!("{url}/v1/stacks?rig=rig&lens=lens")).body(zip()).send().await;
        let posted = posted.expect("an answer");
        assert_eq!(posted.status(), StatusCode::ACCEPTED, "{sink:?}");
        let path = posted.headers()["location"].to_str().expect("a path").to_owned();
        loop {
            let stack: serde_json::Value =
                client.get(format!("{url}{path}")).send().await.expect("an answer").json().await.expect("JSON");
            if stack["state"] == "succeeded" {
                break;
            }
            assert!(["queued", "running"].iter().any(|state| stack["state"] == *state), "{sink:?}: {stack}");
            tokio::time::sleep(LOOK).await;
        }
        // they end well on SIGTERM, and do not wait for the log for long
        worker.stop().await;
        api.stop().await;
        verified(|arguments| command(&data, arguments));
    }
}
