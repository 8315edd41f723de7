//! Resumable uploads with common tus clients, over an unreliable network and across `kill -9`.

use std::{fs, path::PathBuf, process::Command, sync::LazyLock};

use pinstack_science::synth::Rig;
use serde_json::Value;

use crate::{
    proxy::Proxy,
    run,
    server::{LOOK, Server, small_rig, write_stack_of},
};

/// Number of connections that are cut before the network is reliable.
const CUTS: usize = 12;

const TUSPY: &str = r#"
import sys
from tusclient import client
endpoint, path = sys.argv[1:]
uploader = client.TusClient(endpoint).uploader(
    path, chunk_size=50_000, upload_checksum=True,
    metadata={'rig': 'rig', 'lens': 'lens', 'filename': 'view.zip', 'options': '{"label": "by tuspy"}'})
while True:
    try:
        if uploader.url:
            uploader.offset = uploader.get_offset()
        uploader.upload()
        break
    except Exception as error:  # also what the client makes of an answer that was torn in its headers
        print(type(error).__name__, file=sys.stderr)
print(uploader.url)
"#;

const TUS_JS: &str = r#"
const fs = require('fs'), tus = require('tus-js-client');
const [endpoint, path] = process.argv.slice(2);
const upload = new tus.Upload(fs.createReadStream(path), {
  endpoint, uploadSize: fs.statSync(path).size, retryDelays: Array(200).fill(0),
  metadata: { rig: 'rig', lens: 'lens', filename: 'view.zip', options: '{"label": "by tus-js-client"}' },
  onError: error => { console.error(String(error)); process.exit(1) },
  onSuccess: () => console.log(upload.url),
});
upload.start();
"#;

/// The rig, and a zip of it that is large enough to be interrupted often.
static STACK: LazyLock<(Rig, Vec<u8>)> = LazyLock::new(|| {
    let (rig, file) = (Rig::sized(900, 600, 4), tempfile::NamedTempFile::new().expect("a file"));
    write_stack_of(&rig, file.path());
    (rig, fs::read(file.path()).expect("the zip"))
});

/// A server with a profile, and the zip.
fn prepared() -> (Server, PathBuf) {
    let server = Server::start();
    let (rig, bytes) = &*STACK;
    let zip = server.folder.path().join("stack.zip");
    fs::write(&zip, bytes).expect("written");
    server.put_profile(rig);
    (server, zip)
}

/// Uploads the zip with a script through a cutting proxy, and checks the result.
fn upload_over_an_unreliable_network(interpreter: &str, script: &str, label: &str, seed: u64) {
    let (server, zip) = prepared();
    let proxy = Proxy::cutting(&server.url, CUTS, seed);
    let file = server.folder.path().join("script");
    fs::write(&file, script).expect("a script");
    let endpoint = format!("{}/v1/uploads", proxy.url);
    let printed = run(Command::new(interpreter).arg(&file).arg(endpoint).arg(&zip));
    assert_eq!(proxy.cuts(), CUTS, "the line was as bad as it should be");
    let path = printed.trim().trim_start_matches(&proxy.url);
    let upload = server.curl(&[], path);
    assert_eq!(upload["state"], "complete", "{upload}");
    let stack = server.curl(&["-H", "Prefer: wait=60"], upload["job"].as_str().expect("a job"));
    assert_eq!(
        (stack["state"].as_str(), stack["options"]["label"].as_str()),
        (Some("succeeded"), Some(label)),
        "{stack}"
    );
    let digest = run(Command::new("sha256sum").arg(&zip));
    assert!(digest.starts_with(stack["upload"]["sha256"].as_str().expect("a digest")), "{stack}");
}

#[test]
#[ignore = "needs curl, python3, tuspy"]
fn tuspy_uploads_a_stack_over_an_unreliable_network() {
    upload_over_an_unreliable_network("python3", TUSPY, "by tuspy", 1);
}

#[test]
#[ignore = "needs curl, node, tus-js-client"]
fn tus_js_client_uploads_a_stack_over_an_unreliable_network() {
    upload_over_an_unreliable_network("node", TUS_JS, "by tus-js-client", 2);
}

#[test]
#[ignore = "needs curl"]
fn a_reported_offset_survives_kill_9_and_the_upload_resumes_there() {
    let (mut server, zip) = prepared();
    let bytes = fs::read(&zip).expect("the zip");
    let path = begin(&server, bytes.len());
    let rest = server.folder.path().join("rest");
    let mut told = 0;
    for killed_after in [30_000, 50_001, 90_000] {
        fs::write(&rest, &bytes[told..killed_after]).expect("a piece");
        told = send(&server, &path, told, &rest);
        assert_eq!(told, killed_after);
        // in the middle of the next piece: what it brings need not be there, what was told must
        let hanging = hanging_piece(&server, &path, told, &bytes[told..told + 10_000]);
        server.kill_and_start_again();
        drop(hanging);
        let upload = server.curl(&[], &path);
        let offset = upload["offset"].as_u64().expect("an offset") as usize;
        assert!((told..=told + 10_000).contains(&offset), "{told} was told, now it is {offset}");
        told = offset;
    }
    fs::write(&rest, &bytes[told..]).expect("a piece");
    assert_eq!(send(&server, &path, told, &rest), bytes.len());
    let job = server.curl(&[], &path)["job"].as_str().expect("a job").to_owned();
    let stack = server.curl(&["-H", "Prefer: wait=60"], &job);
    assert_eq!(stack["state"], "succeeded", "{stack}");
    let digest = run(Command::new("sha256sum").arg(&zip));
    assert!(digest.starts_with(stack["upload"]["sha256"].as_str().expect("a digest")), "{stack}");
}

/// Creates an upload and returns its path.
pub fn begin(server: &Server, length: usize) -> String {
    let url = format!("{}/v1/uploads", server.url);
    let length = format!("Upload-Length: {length}");
    let metadata = "Upload-Metadata: rig cmln,lens bGVucw==";
    run(Command::new("curl")
        .args(["-sS", "--fail", "-X", "POST", "-H", "Tus-Resumable: 1.0.0", "-o", "/dev/null"])
        .args(["-H", &length, "-H", metadata, "-w", "%header{location}", &url]))
}

/// Sends a file as the next part and returns the reported offset.
pub fn send(server: &Server, path: &str, offset: usize, file: &std::path::Path) -> usize {
    let url = format!("{}{path}", server.url);
    let offset = format!("Upload-Offset: {offset}");
    let told = run(Command::new("curl")
        .args(["-sS", "--fail", "-X", "PATCH", "-H", "Tus-Resumable: 1.0.0", "-H", &offset, "-T"])
        .arg(file)
        .args(["-H", "Content-Type: application/offset+octet-stream", "-w", "%header{upload-offset}", &url]));
    told.trim().parse().unwrap_or_else(|_| panic!("no offset: {told}"))
}

/// Sends a part whose last byte never arrives.
fn hanging_piece(server: &Server, path: &str, offset: usize, bytes: &[u8]) -> std::net::TcpStream {
    use std::io::Write;
    let mut socket = std::net::TcpStream::connect(server.url.trim_start_matches("http://")).expect("a connection");
    let head = format!(
        "PATCH {path} HTTP/1.1\r\nhost: localhost\r\ntus-resumable: 1.0.0\r\nupload-offset: {offset}\r\ncontent-type: application/offset+octet-stream\r\ncontent-length: {}\r\n\r\n",
        bytes.len() + 1
    );
    socket.write_all(head.as_bytes()).and_then(|()| socket.write_all(bytes)).expect("it is sent");
    let id = path.rsplit('/').next().expect("an id");
    let file = server.folder.path().join(format!("data/partial/{id}.part"));
    let written = || fs::metadata(&file).map(|m| m.len() as usize).unwrap_or(0);
    while written() < offset + bytes.len() {
        std::thread::sleep(LOOK);
    }
    socket
}

#[test]
#[ignore = "needs curl"]
fn a_part_is_not_counted_by_a_killed_server_before_it_is_durable() {
    let server = Server::start();
    server.put_profile(&small_rig());
    let path = begin(&server, 20_000);
    let _hanging = hanging_piece(&server, &path, 0, &[1; 10_000]);
    let upload: Value = server.curl(&[], &path);
    assert_eq!(upload["offset"], 0, "written, but not synced yet: {upload}");
}
