//! What clients do through a proxy.

use std::{
    fs::{self, File},
    io::{BufRead, BufReader},
    path::Path,
    process::{Command, Stdio},
};

use serde_json::Value;

use super::started::Proxy;
use crate::{
    run,
    server::{LOOK, Server, profile_of, small_rig, write_stack_of},
};

/// Bytes of the large upload.
const LARGE: u64 = 256 << 20;

const ZIP: [&str; 2] = ["-H", "Content-Type: application/zip"];
const TUS: [&str; 2] = ["-H", "Tus-Resumable: 1.0.0"];
const METADATA: &str = "Upload-Metadata: rig cmln,lens bGVucw==";

/// A service that requires a token and believes only 127.0.0.1, with a profile, a scan of one fused view, and nothing
/// that runs further jobs.
pub struct Site {
    pub server: Server,
    token: String,
}

impl Site {
    pub fn prepared() -> Self {
        let (mut server, token) = Server::start_with_a_token();
        let folder = server.folder.path().to_owned();
        let bearer = format!("Authorization: Bearer {token}");
        let rig = small_rig();
        let json = |method: &str, body: &Value, path: &str| {
            let body = body.to_string();
            let (kind, method) = ("Content-Type: application/json", ["-X", method, "-d", body.as_str()]);
            server.curl(&[&method[..], &["-H", kind, "-H", &bearer]].concat(), path)
        };
        json("PUT", &profile_of(&rig), "/v1/profiles/rig/lens");
        json("PUT", &serde_json::json!({ "rig": "rig", "lens": "lens" }), "/v1/scans/bee");
        let zip = folder.join("stack.zip");
        write_stack_of(&rig, &zip);
        let sent = ["-X", "POST", "-T", zip.to_str().expect("UTF-8"), "-H", &bearer, "-H", "Prefer: wait=50"];
        let stack = server
            .curl(&[&sent[..], &ZIP].concat(), "/v1/stacks?rig=rig&lens=lens&scan=bee&pan_deg=0&tilt_deg=0&label=view");
        assert_eq!(stack["state"], "succeeded", "{stack}");
        let mut command = Command::new("sh");
        command.args(["-c", "exec \"$0\" \"$@\" 2>\"$LOG\"", env!("CARGO_BIN_EXE_pinstack")]);
        command.env("LOG", folder.join("log")).env("PINSTACK_WORKERS", "0");
        command.env("PINSTACK_TRUSTED_PROXIES", "[\"127.0.0.1\"]");
        server.start_again_by(command);
        Self { server, token }
    }
}

/// The path of a job that waits, of a service without tokens and workers.
pub fn queued(server: &Server) -> String {
    let rig = small_rig();
    server.put_profile(&rig);
    let zip = server.folder.path().join("stack.zip");
    write_stack_of(&rig, &zip);
    let sent = ["-X", "POST", "-T", zip.to_str().expect("UTF-8")];
    let stack = server.curl(&[&sent[..], &ZIP].concat(), "/v1/stacks?rig=rig&lens=lens");
    stack["links"]["self"].as_str().expect("a link").to_owned()
}

/// All of them.
pub fn all(site: &Site, proxy: &Proxy) {
    sign_in(site, proxy);
    assert_eq!(run(proxy.curl().args(["-o", "page", "-w", "%{http_version}", &proxy.at("/")])), "2");
    pages_have_their_scripts(proxy);
    stacks_are_sent_and_followed(site, proxy);
    uploads_are_resumed(site, proxy);
    refusals_arrive_while_the_body_is_sent(proxy);
    downloads_are_resumed(proxy);
    the_log_names_the_client(site, proxy);
    if proxy.prefix.is_empty() {
        zeros_pass(proxy, LARGE);
    } else {
        the_python_client_works(site, proxy);
    }
    // a client cannot say where the service is
    let claims = ["-X", "POST", "-H", "X-Forwarded-Prefix: /elsewhere", "-H", "Accept: text/html"];
    assert_eq!(proxy.ask(&claims, &proxy.at("/sign-out")).1, format!("{}/sign-in", proxy.prefix));
}

/// A person signs in; the cookie is kept for https and the path alone.
pub fn sign_in(site: &Site, proxy: &Proxy) {
    let (token, prefix) = (&site.token, proxy.prefix);
    let (status, location, _) = proxy.ask(&["-H", "Accept: text/html"], &proxy.at("/"));
    assert_eq!((status, location), (303, format!("{prefix}/sign-in?next=%2F")));
    let form = format!("token={token}&next=/scans");
    let (status, location, body) = proxy.ask(&["-d", &form], &proxy.at("/sign-in"));
    assert_eq!((status, location), (303, format!("{prefix}/scans")), "{body}");
    let jar = fs::read_to_string(proxy.file("jar")).expect("a cookie");
    let (kind, path) = if prefix.is_empty() { ("__Host-", "/") } else { ("__Secure-", "/pinstack") };
    assert!(jar.contains(&format!("{kind}pinstack_token")) && jar.contains(&format!("\t{path}\tTRUE\t")), "{jar}");
}

/// Every script and style of the first page, and the document of the API, are found at the path.
fn pages_have_their_scripts(proxy: &Proxy) {
    let page = fs::read_to_string(proxy.file("page")).expect("a page");
    let attributes = page.split("src=\"").chain(page.split("rel=\"stylesheet\" href=\"")).skip(1);
    let links: Vec<&str> =
        attributes.filter_map(|rest| rest.split('"').next()).filter(|l| l.starts_with('/')).collect();
    assert!(links.len() >= 2, "{page}");
    for link in links {
        assert!(link.starts_with(proxy.prefix), "{link}");
        assert_eq!(proxy.ask(&[], &format!("{}{link}", proxy.origin())).0, 200, "{link}");
    }
    let (status, _, document) = proxy.ask(&[], &proxy.at("/openapi.json"));
    let document: Value = serde_json::from_str(&document).expect("JSON");
    let url = document["servers"][0]["url"].as_str().expect("an address").trim_end_matches('/');
    assert!(status == 200 && (url == proxy.prefix || url == proxy.at("")), "{url}");
}

/// A stack is sent with `Expect: 100-continue`; its first event arrives while the stream goes on.
fn stacks_are_sent_and_followed(site: &Site, proxy: &Proxy) {
    let zip = site.server.folder.path().join("stack.zip");
    let sent = ["--http1.1", "-H", "Expect: 100-continue", "-X", "POST", "-T", zip.to_str().expect("UTF-8")];
    let (status, location, body) = proxy.ask(&[&sent[..], &ZIP].concat(), &proxy.at("/v1/stacks?rig=rig&lens=lens"));
    let stack: Value = serde_json::from_str(&body).unwrap_or_else(|_| panic!("{body}"));
    assert_eq!((status, Some(location.as_str())), (202, stack["links"]["self"].as_str()), "{body}");
    assert!(location.starts_with(&format!("{}/v1/stacks/", proxy.prefix)), "{location}");
    let url = format!("{}{location}", proxy.origin());
    for version in ["--http1.1", "--http2"] {
        let mut events = proxy.curl();
        events.args([version, "-N", &format!("{url}/events")]).stdout(Stdio::piped());
        let mut events = events.spawn().expect("curl starts");
        let mut lines = BufReader::new(events.stdout.take().expect("a pipe")).lines();
        assert_eq!(lines.next().expect("a line").expect("text"), "event: state");
        events.kill().and_then(|()| events.wait()).expect("it ended");
    }
    assert_eq!(proxy.ask(&["-X", "DELETE"], &url).0, 204);
}

/// Creates an upload; its URL, which is on the host of the proxy.
fn upload(proxy: &Proxy, bytes: u64) -> String {
    let length = format!("Upload-Length: {bytes}");
    let (status, location, body) =
        proxy.ask(&[&TUS[..], &["-X", "POST", "-H", &length, "-H", METADATA]].concat(), &proxy.at("/v1/uploads"));
    assert!(
        status == 201 && location.starts_with(&format!("{}/v1/uploads/", proxy.prefix)),
        "{status} {location} {body}"
    );
    format!("{}{location}", proxy.origin())
}

/// Sends a piece of an upload; the answer.
fn patch(proxy: &Proxy, url: &str, offset: u64, file: &Path) -> (u16, String, String) {
    let offset = format!("Upload-Offset: {offset}");
    let kind = "Content-Type: application/offset+octet-stream";
    let sent = ["-X", "PATCH", "-H", &offset, "-H", kind, "-T", file.to_str().expect("UTF-8")];
    proxy.ask(&[&TUS[..], &sent].concat(), url)
}

/// What `HEAD` says of an upload.
fn offset(proxy: &Proxy, url: &str) -> u64 {
    let mut curl = proxy.curl();
    curl.args(TUS).args(["-I", "-o", "head", "-w", "%header{upload-offset}", url]);
    run(&mut curl).parse().expect("an offset")
}

/// An upload in two pieces becomes a stack.
fn uploads_are_resumed(site: &Site, proxy: &Proxy) {
    let zip = fs::read(site.server.folder.path().join("stack.zip")).expect("a zip");
    let (first, rest) = zip.split_at(zip.len() / 2);
    let url = upload(proxy, zip.len() as u64);
    for part in [first, rest] {
        let file = proxy.file("part");
        fs::write(&file, part).expect("a file");
        let (status, _, body) = patch(proxy, &url, offset(proxy, &url), &file);
        assert_eq!(status, 204, "{body}");
    }
    let stack = url.replace("/v1/uploads/", "/v1/stacks/");
    assert_eq!(proxy.ask(&["-X", "DELETE"], &stack).0, 204, "the upload is a stack");
}

/// A service refuses before it has the body; the reason arrives all the same.
fn refusals_arrive_while_the_body_is_sent(proxy: &Proxy) {
    let zeros = proxy.file("zeros");
    File::create(&zeros).and_then(|file| file.set_len(LARGE)).expect("a file");
    for &version in proxy.versions_of_refusals() {
        for expect in ["Expect:", "Expect: 100-continue"] {
            let sent = [version, "-X", "POST", "-T", "zeros", "-H", expect];
            let unknown = proxy.at("/v1/stacks?rig=rig&lens=unknown");
            let (status, _, body) = proxy.ask(&[&sent[..], &ZIP].concat(), &unknown);
            assert!(status == 404 && body.contains("\"profile_not_found\""), "{version} {expect} {status} {body}");
        }
    }
}

/// Ranges of a file and of a bundle are those of the whole, and a download that was cut off is continued.
fn downloads_are_resumed(proxy: &Proxy) {
    let (_, _, scan) = proxy.ask(&[], &proxy.at("/v1/stacks?scan=bee"));
    let scan: Value = serde_json::from_str(&scan).expect("JSON");
    let image = scan["items"][0]["links"]["image"].as_str().unwrap_or_else(|| panic!("{scan}")).to_owned();
    for url in [format!("{}{image}", proxy.origin()), proxy.at("/v1/scans/bee/bundle?layout=colmap")] {
        run(proxy.curl().args(["--fail", "-o", "whole", &url]));
        let whole = fs::read(proxy.file("whole")).expect("a file");
        assert_eq!(proxy.ask(&["-r", "100-299", "-o", "range"], &url).0, 206, "{url}");
        fs::write(proxy.file("again"), &whole[..whole.len() / 3]).expect("a file");
        run(proxy.curl().args(["--fail", "-C", "-", "-o", "again", &url]));
        assert!(fs::read(proxy.file("again")).expect("a file") == whole, "{url}");
    }
}

/// The log has the address of the client, not that of the proxy, and not one that the client claims.
fn the_log_names_the_client(site: &Site, proxy: &Proxy) {
    let id = format!("from-nine-{}", proxy.port);
    let claims =
        ["--interface", "127.0.0.9", "-H", "X-Forwarded-For: 203.0.113.7", "-H", &format!("X-Request-Id: {id}")];
    assert_eq!(proxy.ask(&claims, &proxy.at("/v1/info")).0, 200);
    let line = loop {
        let log = fs::read_to_string(site.server.folder.path().join("log")).expect("a log");
        if let Some(line) = log.lines().find(|line| line.contains(&id)) {
            break line.to_owned();
        }
        std::thread::sleep(LOOK);
    };
    assert!(line.contains("client=127.0.0.9"), "{line}");
}

/// So many zeros arrive by POST and in pieces; that they are no zip is said at the end.
pub fn zeros_pass(proxy: &Proxy, bytes: u64) {
    let zeros = proxy.file("zeros");
    File::create(&zeros).and_then(|file| file.set_len(bytes)).expect("a file");
    let sent = ["-X", "POST", "-T", "zeros"];
    let (status, _, body) = proxy.ask(&[&sent[..], &ZIP].concat(), &proxy.at("/v1/stacks?rig=rig&lens=lens"));
    assert!(status == 422 && body.contains("\"invalid_archive\""), "{status} {body}");
    let url = upload(proxy, 2 * bytes);
    for at in [0, bytes] {
        assert_eq!(offset(proxy, &url), at);
        let (status, _, body) = patch(proxy, &url, at, &zeros);
        let is_last = at > 0;
        assert!(if is_last { body.contains("\"invalid_archive\"") } else { status == 204 }, "{status} {body}");
    }
    fs::remove_file(zeros).expect("it was there");
}

/// The Python client sends a stack in pieces, follows links, and resumes a bundle.
fn the_python_client_works(site: &Site, proxy: &Proxy) {
    let script = "
import socket, ssl, sys
from pinstack import Client
url, token, zipped, bundle = sys.argv[1:]
look_up = socket.getaddrinfo
socket.getaddrinfo = lambda host, *rest, **named: look_up('127.0.0.1', *rest, **named)
with Client(url, token, verify=ssl.create_default_context(cafile='own.pem'), piece_bytes=100_000) as client:
    stack = client.send_stack(zipped, 'rig', 'lens')
    assert client.get_stack(stack)['state'] == 'queued'
    client.delete(stack)
    client.save_bundle('bee', 'colmap', bundle)
";
    let zip = site.server.folder.path().join("stack.zip");
    let mut python = Command::new("python3");
    python.current_dir(proxy.file("")).args(["-c", script, &proxy.at(""), &site.token]).arg(zip).arg("bundle.zip");
    python.env("PYTHONPATH", Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/python/src"));
    run(python.env("PYTHONDONTWRITEBYTECODE", "1"));
    assert!(proxy.file("bundle.zip").exists());
}
