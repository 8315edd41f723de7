//! A process that is killed while COLMAP runs: the next one continues, and nothing of the first is left.

use std::{fs, os::unix::fs::PermissionsExt, path::Path};

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use crate::{
    input::{profile, zip},
    service::{LOOK, Service, command, verified},
};

/// Hangs the first time, then finds nothing.
fn program(folder: &Path) -> String {
    let (path, mark) = (folder.join("colmap"), folder.join("number"));
    let mark = mark.display();
    let text = format!(
        "#!/bin/sh\ncase \"$1\" in\nhelp) echo 'COLMAP 3.8 -- ' ;;\nmapper)\n\
         if [ -e {mark} ]; then echo 'No good initial image pair found'; exit 1; fi\n\
         echo $$ > {mark}.new; mv {mark}.new {mark}; exec sleep 1000 ;;\nesac\n"
    );
    fs::write(&path, text).expect("a script");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a mode");
    path.display().to_string()
}

/// Asks until the job has ended.
async fn ended(client: &reqwest::Client, url: &str) -> Value {
    loop {
        let asked = client.get(url).header("prefer", "wait=20").send().await.expect("an answer");
        let job: Value = asked.json().await.expect("JSON");
        if job["finished_at"].is_string() {
            return job;
        }
    }
}

/// Killed between the last view and its reconstruction, the service makes it once, and only once.
#[tokio::test]
async fn a_scan_is_reconstructed_by_itself_once_wherever_the_service_is_killed() {
    let killed = ["rows.enqueue=2*off", "rows.scan_examined=0*off", "rows.scan_examined=1*off"];
    futures::future::join_all(killed.map(reconstructed_once)).await;
}

async fn put(client: &reqwest::Client, url: &str, body: &Value) {
    let answer = client.put(url).json(body).send().await.expect("sent");
    assert!(answer.status().is_success(), "{url}: {}", answer.status());
}

/// Makes the scan `bee` with a view that is fused; returns the path of its stack.
async fn scan_of_one_view(client: &reqwest::Client, url: &str) -> String {
    put(client, &format!("{url}/v1/profiles/rig/lens"), &profile()).await;
    put(client, &format!("{url}/v1/scans/bee"), &serde_json::json!({ "rig": "rig", "lens": "lens" })).await;
    let posted =
        client.post(format!("{url}/v1/stacks?rig=rig&lens=lens&scan=bee")).body(zip()).send().await.expect("sent");
    let stack = posted.headers()["location"].to_str().expect("a path").to_owned();
    assert_eq!(ended(client, &format!("{url}{stack}")).await["state"], "succeeded");
    stack
}

async fn reconstructed_once(killed: &str) {
    let folder = TempDir::new().expect("a folder");
    let (data, colmap) = (folder.path().join("data"), program(folder.path()));
    fs::write(folder.path().join("number"), "it does not hang").expect("written");
    let more = ["--colmap", colmap.as_str()];
    let fault = format!("{killed}->1*return(kill)->off");
    let mut first = Service::start(&data, Some(&fault), &more).await.expect("it listens");
    let client = reqwest::Client::builder().no_proxy().build().expect("a client");
    let url = first.url.clone();
    let stack = scan_of_one_view(&client, &url).await;
    let auto = serde_json::json!({ "rig": "rig", "lens": "lens", "expected_views": 1, "reconstruct": "auto" });
    put(&client, &format!("{url}/v1/scans/bee"), &auto).await;
    first.ended().await;

    let second = Service::start(&data, None, &more).await.expect("it listens");
    let url = second.url.clone();
    let made = async |number: usize| loop {
        let asked = client.get(format!("{url}/v1/scans/bee/reconstructions")).send().await.expect("an answer");
        let list: Value = asked.json().await.expect("JSON");
        let items = list["items"].as_array().expect("a list").clone();
        if items.len() >= number {
            return items;
        }
        tokio::time::sleep(LOOK).await;
    };
    let [one] = made(1).await.try_into().expect("one");
    let one = ended(&client, &format!("{url}{}", one["links"]["self"].as_str().expect("a path"))).await;
    assert_eq!(one["result"]["findings"][0]["code"], "no_model", "{one}");
    // the view is replaced: the state before it was examined for good
    let again = client.post(format!("{url}{stack}/rerun")).send().await.expect("sent");
    assert!(again.status().is_success());
    assert_eq!(made(2).await.len(), 2, "{killed}");
    second.stop().await;
    verified(|arguments| command(&data, arguments));
}

#[tokio::test]
async fn a_reconstruction_whose_process_is_killed_is_run_again_and_its_program_ends() {
    let folder = TempDir::new().expect("a folder");
    let (data, colmap) = (folder.path().join("data"), program(folder.path()));
    let more = ["--colmap", colmap.as_str()];
    let mut first = Service::start(&data, None, &more).await.expect("it listens");
    let client = reqwest::Client::builder().no_proxy().build().expect("a client");
    let url = first.url.clone();
    scan_of_one_view(&client, &url).await;
    let posted = client.post(format!("{url}/v1/scans/bee/reconstructions")).send().await.expect("sent");
    let job = posted.headers()["location"].to_str().expect("a path").to_owned();
    let mark = folder.path().join("number");
    while !mark.exists() {
        tokio::time::sleep(LOOK).await;
    }
    let number = fs::read_to_string(&mark).expect("a number").trim().to_owned();
    first.signal(Signal::KILL);
    first.ended().await;

    let second = Service::start(&data, None, &more).await.expect("it listens");
    let made = ended(&client, &format!("{}{job}", second.url)).await;
    assert_eq!((made["state"].as_str(), made["attempt"].as_u64()), (Some("succeeded"), Some(2)), "{made}");
    assert_eq!(made["result"]["findings"][0]["code"], "no_model", "{made}");
    // the system killed it with its parent
    let status = fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
    assert!(status.is_empty() || status.contains(") Z "), "the program of the first process lives: {status}");
    second.stop().await;
    verified(|arguments| command(&data, arguments));
}
