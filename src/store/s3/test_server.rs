//! An S3 server for tests. Other tests of the project include this file too.
//!
//! The server is that of `PINSTACK_TEST_S3_ENDPOINT`, whose key in `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY` may
//! make buckets in the region `us-east-1`, or moto, a Python program that keeps buckets in memory. It runs in
//! `moto-python`, a Python with moto, or in `python3`. It ends with the process of the tests, however that ends,
//! because it waits for the end of its input. moto checks neither signatures nor digests, and never fails on its own.

use std::{
    io::{BufRead, BufReader, Write},
    process::{ChildStdin, Command, Stdio},
    sync::OnceLock,
};

/// Prints the address, and ends with its input.
const SCRIPT: &str = r"
import sys, threading, logging
from moto.server import ThreadedMotoServer
logging.getLogger('werkzeug').setLevel(logging.CRITICAL)
server = ThreadedMotoServer(ip_address='127.0.0.1', port=0, verbose=False)
server.start()
print('http://%s:%s' % server.get_host_and_port(), flush=True)
sys.stdin.read()
server.stop()
";

/// Succeeds with a moto that sends what a signed URL says of the answer's headers; 5.2.1 does not.
const HAS_MOTO: &str = r"
import sys, moto, moto.server
sys.exit(tuple(int(part) for part in moto.__version__.split('.')[:3]) < (5, 2, 5))
";

/// A running server. A private one ends when the pipe is closed.
pub(super) struct Server {
    /// Its address.
    pub(super) endpoint: String,
    _pipe: Option<ChildStdin>,
}

/// The server, which is started by the first caller.
///
/// # Panics
/// When there is none, or it does not start.
pub(super) fn server() -> &'static Server {
    static SERVER: OnceLock<Server> = OnceLock::new();
    SERVER.get_or_init(|| match std::env::var("PINSTACK_TEST_S3_ENDPOINT") {
        Ok(endpoint) => Server { endpoint, _pipe: None },
        Err(_) => private(),
    })
}

#[expect(clippy::zombie_processes, reason = "it ends with this process, when its input is closed")]
fn private() -> Server {
    let has_moto = |python: &&str| {
        let tried = Command::new(python).args(["-c", HAS_MOTO]).output();
        tried.is_ok_and(|done| done.status.success())
    };
    let python = ["moto-python", "python3"].into_iter().find(has_moto);
    let python = python.expect("moto 5.2.5 is not installed (pip install moto flask flask-cors)");
    let mut python = Command::new(python)
        .args(["-c", SCRIPT])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("python3");
    let mut endpoint = String::new();
    BufReader::new(python.stdout.take().expect("piped")).read_line(&mut endpoint).expect("it writes a line");
    assert!(endpoint.starts_with("http://"), "the S3 server for tests did not start");
    Server { endpoint: endpoint.trim().to_owned(), _pipe: python.stdin.take() }
}

/// A credentials file for the server, as text.
pub(super) fn credentials() -> String {
    let of = |variable: &str| std::env::var(variable).unwrap_or_else(|_| "test".into());
    let (id, secret) = (of("AWS_ACCESS_KEY_ID"), of("AWS_SECRET_ACCESS_KEY"));
    format!("[default]\naws_access_key_id = {id}\naws_secret_access_key = {secret}\n")
}

impl Server {
    /// Makes a bucket and returns its name. The client of the service cannot make any, so curl does.
    pub(super) fn bucket(&self) -> String {
        let bucket = format!("test-{}", uuid::Uuid::now_v7().simple());
        let mut curl = Command::new("curl")
            .args(["-sS", "--fail-with-body", "--config", "-", "-X", "PUT"])
            .args(["--aws-sigv4", "aws:amz:us-east-1:s3", "-H", "x-amz-content-sha256: UNSIGNED-PAYLOAD"])
            .arg(format!("{}/{bucket}", self.endpoint))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("curl");
        let key = credentials();
        let of = |name: &str| key.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default();
        let user = format!("user = \"{}:{}\"\n", of("aws_access_key_id = "), of("aws_secret_access_key = "));
        curl.stdin.take().expect("piped").write_all(user.as_bytes()).expect("sent");
        let done = curl.wait_with_output().expect("curl");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stdout));
        bucket
    }
}
