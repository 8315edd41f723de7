//! TLS with curl as the client.

use std::{
    fs,
    path::Path,
    process::{Child, Command, Stdio},
};

use crate::{run, server::LOOK};

/// A server process, killed when dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Makes `{name}.pem` and `{name}.key` for 127.0.0.1 and the hosts of the documentation.
pub fn certificate(folder: &Path, name: &str) {
    run(Command::new("openssl").current_dir(folder).args([
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=pinstack",
        "-addext",
        "subjectAltName=IP:127.0.0.1,DNS:pinstack.example,DNS:lab.example",
        "-keyout",
        &format!("{name}.key"),
        "-out",
        &format!("{name}.pem"),
    ]));
}

fn pinstack(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.current_dir(folder).args(arguments);
    command
}

fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = pinstack(folder, arguments).output().expect("pinstack starts");
    assert!(!output.status.success(), "{arguments:?} went well");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
#[ignore = "needs curl, openssl"]
fn with_a_certificate_the_server_accepts_only_tls() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    for name in ["own", "other"] {
        certificate(folder, name);
    }
    let serve =
        ["serve", "--listen", "127.0.0.1:0", "--port-file", "port", "--tls-cert", "own.pem", "--tls-key", "own.key"];
    let mut command = pinstack(folder, &serve);
    let mut server = Process(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("pinstack starts"));
    let address = loop {
        if let Ok(address) = fs::read_to_string(folder.join("port")) {
            break address.trim().to_owned();
        }
        assert!(server.0.try_wait().expect("it can be asked").is_none(), "pinstack serve ended");
        std::thread::sleep(LOOK);
    };
    let curl = |arguments: &[&str]| {
        let output =
            Command::new("curl").current_dir(folder).args(["-sS", "--max-time", "60"]).args(arguments).output();
        let output = output.expect("curl starts");
        (output.status.success(), String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let url = format!("https://{address}/readyz");
    for version in [["--tlsv1.2", "--tls-max", "1.2"], ["--tlsv1.3", "--tls-max", "1.3"]] {
        let (went_well, told) = curl(&[&version[..], &["--cacert", "own.pem", &url]].concat());
        assert!(went_well && told.contains("\"ready\":true"), "{version:?}: {told}");
    }
    assert!(!curl(&["--cacert", "other.pem", &url]).0, "it is not taken for another");
    assert!(!curl(&[&format!("http://{address}/readyz")]).0, "nothing is said in clear text");

    // the health check of a container knows the certificate by its settings
    let health = |certificate: &str| {
        pinstack(folder, &["health", &format!("https://{address}")]).env("PINSTACK_TLS_CERT", certificate).output()
    };
    let healthy = health("own.pem").expect("pinstack starts");
    assert!(healthy.status.success(), "{}", String::from_utf8_lossy(&healthy.stderr));
    assert!(!health("other.pem").expect("pinstack starts").status.success());
}

#[test]
#[ignore = "needs openssl"]
fn an_unusable_certificate_is_refused_with_its_file_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    for name in ["own", "other"] {
        certificate(folder, name);
    }
    fs::write(folder.join("empty.pem"), "").expect("a file");
    let serve = |certificate: &str, key: &str| {
        refusal(folder, &["serve", "--listen", "127.0.0.1:0", "--tls-cert", certificate, "--tls-key", key])
    };
    assert!(serve("missing.pem", "own.key").contains("missing.pem"));
    assert!(serve("empty.pem", "own.key").contains("no certificate in empty.pem"));
    assert!(serve("own.pem", "own.pem").contains("private key in PEM from own.pem"));
    assert!(serve("own.pem", "other.key").contains("other.key does not match the certificate own.pem"));
    let told = refusal(folder, &["serve", "--tls-cert", "own.pem"]);
    assert!(told.contains("belong together"), "{told}");
}
