//! `pinstack token`, and a server that requires tokens: secrets, the last token, rights of files.

use std::{
    path::Path,
    process::{Child, Command, Stdio},
};

use reqwest::StatusCode;

use crate::{
    access::{POST, secret_of},
    app::{profile, stack_zip},
};

/// A server process, killed on drop.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn pinstack(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.current_dir(folder).args(arguments);
    command
}

/// Runs a command. Returns whether it succeeded, its output and its error output.
fn said(folder: &Path, arguments: &[&str]) -> (bool, String, String) {
    let output = pinstack(folder, arguments).output().expect("the program runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    (output.status.success(), text(&output.stdout), text(&output.stderr))
}

/// Starts a server that logs everything into `log`, and waits for its address.
fn serving(folder: &Path, arguments: &[&str]) -> (Process, String) {
    let log = std::fs::File::create(folder.join("log")).expect("a log");
    let port_file = folder.join("port");
    let mut command = pinstack(folder, &["serve", "--workers", "0", "--log", "trace", "--port-file", "port"]);
    command.args(arguments).stdout(log.try_clone().expect("a log")).stderr(Stdio::from(log));
    let mut process = Process(command.spawn().expect("the program starts"));
    loop {
        if let Ok(address) = std::fs::read_to_string(&port_file) {
            return (process, address.trim().to_owned());
        }
        let ended = process.0.try_wait().expect("it can be asked");
        assert!(ended.is_none(), "{}", std::fs::read_to_string(folder.join("log")).unwrap_or_default());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

#[test]
fn listening_beyond_loopback_requires_an_explicit_auth_setting() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let (went_well, _, told) = said(folder, &["serve", "--listen", "0.0.0.0:0"]);
    assert!(!went_well && told.contains("pinstack token add") && told.contains("--auth none"), "{told}");
    let (process, _) = serving(folder, &["--listen", "0.0.0.0:0", "--auth", "none"]);
    drop(process);
    std::fs::remove_file(folder.join("port")).expect("the port file");
    assert!(said(folder, &["token", "add", "rig-pc", "--scope", "read"]).0);
    let (_process, address) = serving(folder, &["--listen", "0.0.0.0:0"]);
    let port = address.rsplit(':').next().expect("a port");
    let (went_well, _, told) = said(folder, &["health", &format!("http://127.0.0.1:{port}")]);
    assert!(went_well, "health needs no token: {told}");
}

#[tokio::test]
async fn token_secrets_are_shown_once_and_stored_nowhere() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let add = ["token", "add", "rig-pc", "--scope", "read", "--scope", "stacks:write"];
    let (went_well, token, _) = said(folder, &add);
    assert!(went_well && token.starts_with("pinstack_") && !token.contains(char::is_whitespace), "{token}");
    let secret = secret_of(&token).to_owned();
    assert!(said(folder, &add).2.contains("choose another name"));
    assert!(said(folder, &["token", "add", "x", "--scope", "everything"]).2.contains("profiles:write"));
    assert!(said(folder, &["token", "add", "../x", "--scope", "read"]).2.contains("A-Z"));
    let (_, listed, _) = said(folder, &["token", "list"]);
    assert!(listed.contains("rig-pc\tread,stacks:write\t") && listed.contains("\tvalid"), "{listed}");
    assert!(!listed.contains(&secret));

    // a token exists, so it is required on the loopback address too
    let (process, address) = serving(folder, &["--listen", "127.0.0.1:0"]);
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let ask = |token: &str| client.get(format!("http://{address}/v1/stacks")).bearer_auth(token).send();
    assert_eq!(ask(&token).await.unwrap().status(), 200);
    assert_eq!(ask(&format!("{token}x")).await.unwrap().status(), 401);
    let (went_well, _, told) = said(folder, &["token", "revoke", "rig-pc"]);
    assert!(went_well, "{told}");
    assert_eq!(ask(&token).await.unwrap().status(), 401);
    assert!(!said(folder, &["token", "revoke", "rig-pc"]).0);
    assert!(said(folder, &["token", "list"]).1.contains("\trevoked "));
    drop(process);
    let log = std::fs::read_to_string(folder.join("log")).expect("the log");
    assert!(log.contains("/v1/stacks"), "it logs what it is asked: {log}");
    for file in ["log", "pinstack-data/pinstack.sqlite", "pinstack-data/pinstack.sqlite-wal"] {
        let bytes = std::fs::read(folder.join(file)).unwrap_or_default();
        assert!(!bytes.windows(secret.len()).any(|window| window == secret.as_bytes()), "{file}");
    }
}

#[tokio::test]
async fn revoking_the_last_token_does_not_open_the_service() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    assert!(said(folder, &["token", "add", "leaked", "--scope", "admin"]).0);
    assert!(said(folder, &["token", "revoke", "leaked"]).0);
    let (process, address) = serving(folder, &["--listen", "127.0.0.1:0"]);
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let status =
        async |address: &str| client.get(format!("http://{address}/v1/stacks")).send().await.unwrap().status().as_u16();
    assert_eq!(status(&address).await, 401);
    drop(process);
    assert!(std::fs::read_to_string(folder.join("log")).unwrap().contains("every token is revoked"));
    std::fs::remove_file(folder.join("port")).expect("the port file");
    let (_process, address) = serving(folder, &["--listen", "127.0.0.1:0", "--auth", "none"]);
    assert_eq!(status(&address).await, 200, "somebody said it by name");
}

#[tokio::test]
async fn a_running_server_requires_tokens_as_soon_as_one_exists() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let (_process, address) = serving(folder, &["--listen", "127.0.0.1:0"]);
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let ask = || client.get(format!("http://{address}/v1/stacks"));
    assert_eq!(ask().send().await.unwrap().status(), 200);
    let (went_well, token, told) = said(folder, &["token", "add", "rig-pc", "--scope", "read"]);
    assert!(went_well && told.contains("from its next request on"), "{told}");
    assert_eq!(ask().send().await.unwrap().status(), 401);
    assert_eq!(ask().bearer_auth(&token).send().await.unwrap().status(), 200);
    assert!(said(folder, &["token", "revoke", "rig-pc"]).0);
    assert_eq!(ask().send().await.unwrap().status(), 401, "and goes on asking");
}

/// Everything below a folder that other accounts can read.
fn open_to_others(folder: &Path) -> Vec<String> {
    use std::os::unix::fs::PermissionsExt;
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("it can be read") {
            let path = entry.expect("an entry").path();
            let metadata = path.metadata().expect("it is there");
            if metadata.permissions().mode() & 0o077 != 0 {
                found.push(format!("{} {:o}", path.display(), metadata.permissions().mode()));
            }
            if metadata.is_dir() {
                folders.push(path);
            }
        }
    }
    found
}

#[tokio::test]
async fn a_data_folder_and_its_backup_are_closed_to_other_accounts() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let data = folder.join("pinstack-data");
    for round in 0..2 {
        let (process, address) = serving(folder, &["--listen", "127.0.0.1:0"]);
        let client = reqwest::Client::builder().no_proxy().build().unwrap();
        let put = client.put(format!("http://{address}/v1/profiles/rig/lens")).json(&profile(2)).send().await.unwrap();
        assert!(put.status().is_success());
        let sent = client.post(format!("http://{address}{POST}")).body(stack_zip(2, 2)).send().await.unwrap();
        assert_eq!(sent.status(), StatusCode::ACCEPTED);
        let begun = client.post(format!("http://{address}/v1/uploads")).header("tus-resumable", "1.0.0");
        let begun = begun.header("upload-length", 10).header("upload-metadata", "rig cmln,lens bGVucw==").body("");
        assert_eq!(begun.send().await.unwrap().status(), StatusCode::CREATED);
        assert!(said(folder, &["backup", "--to", "copy"]).0);
        drop(process);
        std::fs::remove_file(folder.join("port")).expect("the port file");
        for private in [&data, &folder.join("copy")] {
            assert_eq!(private.metadata().unwrap().permissions().mode() & 0o777, 0o700, "{}", private.display());
            let mut open = open_to_others(private);
            // files of older versions are in folders that only the owner can enter
            open.retain(|path| round == 0 || !path.contains("blobs/uploads/"));
            assert!(open.is_empty(), "{open:#?}");
        }
        // as an older version left them
        for path in
            [data.clone(), data.join("blobs"), data.join("blobs/uploads"), data.join("spool"), data.join("partial")]
        {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        }
        std::fs::set_permissions(data.join("pinstack.sqlite"), std::fs::Permissions::from_mode(0o644)).unwrap();
    }
}

#[test]
fn a_token_that_cannot_be_shown_is_not_stored() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let add = ["token", "add", "rig-pc", "--scope", "read"];
    let full = || Stdio::from(std::fs::File::options().write(true).open("/dev/full").expect("Linux has it"));
    let closed = || Stdio::from(std::io::pipe().expect("a pipe").1);
    for sink in [&full as &dyn Fn() -> Stdio, &closed] {
        let output = pinstack(folder, &add).stdout(sink()).output().expect("the program runs");
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains("cannot write to the standard output"), "{told}");
    }
    assert_eq!(said(folder, &["token", "list"]), (true, String::new(), String::new()));
    // what is told on stderr besides is not needed
    let output = pinstack(folder, &add).stderr(full()).output().expect("the program runs");
    assert!(output.status.success() && output.stdout.starts_with(b"pinstack_"));
    assert!(said(folder, &["token", "list"]).1.starts_with("rig-pc\tread"));
}

#[test]
fn a_command_that_cannot_write_its_result_says_so_and_never_panics() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let folder = folder.path();
    let full = || Stdio::from(std::fs::File::options().write(true).open("/dev/full").expect("Linux has it"));
    let closed = || Stdio::from(std::io::pipe().expect("a pipe").1);
    for command in [&["gc"][..], &["verify"], &["openapi"], &["doctor"], &["token", "revoke", "no-such-token"]] {
        let output = pinstack(folder, command).stdout(full()).output().expect("the program runs");
        assert_eq!(output.status.code(), Some(1), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
        for (out, errors) in [(full(), full()), (closed(), closed())] {
            let status = pinstack(folder, command).stdout(out).stderr(errors).status().expect("the program runs");
            assert!(matches!(status.code(), Some(0 | 1)), "{command:?}: {status}");
        }
    }
}
