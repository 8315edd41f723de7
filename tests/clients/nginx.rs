//! nginx in front of the service, configured as the documentation says, with a browser's requests by curl.

use std::{
    fs,
    io::{BufRead, BufReader},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
};

use serde_json::Value;

use crate::{
    run,
    server::{LOOK, Server, profile_of, small_rig, write_stack_of},
    tls::certificate,
};

/// A running nginx, killed when dropped.
struct Nginx {
    process: Child,
    /// Address of the service behind it.
    url: String,
    /// Its origin, as browsers write it.
    origin: String,
}

/// The block of the documentation that begins with this line.
fn documented(fence: &str) -> String {
    let page = include_str!("../../docs/ACCESS.md");
    let block = page.split(&format!("\n```{fence}\n")).nth(1).expect("the documentation has it");
    block.split("\n```").next().expect("it ends").to_owned()
}

/// The name of a directive, and the header that it sets if it does.
fn directive(line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    words[..words.len().min(if line.contains("proxy_set_header") { 2 } else { 1 })].join(" ")
}

/// The configuration of the documentation; below a sub-path with the lines that it changes for that.
fn configuration(below_a_sub_path: bool) -> String {
    let mut lines: Vec<String> = documented("nginx").lines().map(str::to_owned).collect();
    if below_a_sub_path {
        for changed in documented("nginx sub-path").lines() {
            let line = lines.iter_mut().find(|line| !line.trim().is_empty() && directive(line) == directive(changed));
            changed.clone_into(line.unwrap_or_else(|| panic!("{changed} changes no line")));
        }
    }
    lines.join("\n")
}

impl Nginx {
    fn start(server: &Server, below_a_sub_path: bool) -> Self {
        let folder = server.folder.path();
        certificate(folder, "own");
        let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
        let shown = folder.display();
        let mut site = configuration(below_a_sub_path);
        for (documented, own) in [
            ("http://127.0.0.1:8080", server.url.as_str()),
            ("listen 443 ssl;", &format!("listen 127.0.0.1:{port} ssl;")),
            ("/etc/ssl/certs/pinstack.example.pem", &format!("{shown}/own.pem")),
            ("/etc/ssl/private/pinstack.example.key", &format!("{shown}/own.key")),
        ] {
            assert!(site.contains(documented), "{documented} is in the documentation");
            site = site.replace(documented, own);
        }
        let scratch = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"];
        let scratch: String = scratch.iter().map(|kind| format!("{kind}_temp_path {shown}/{kind};\n")).collect();
        let whole = format!(
            "daemon off;\npid {shown}/nginx.pid;\nevents {{}}\nhttp {{\naccess_log off;\n{scratch}{site}\n}}\n"
        );
        fs::write(folder.join("nginx.conf"), whole).expect("the folder can be written");
        let mut nginx = Command::new("nginx");
        nginx.arg("-c").arg(folder.join("nginx.conf")).arg("-e").arg(folder.join("nginx.log"));
        let mut process = nginx.spawn().expect("nginx starts");
        let address = format!("127.0.0.1:{port}");
        while TcpStream::connect(&address).is_err() {
            assert!(process.try_wait().expect("it can be asked").is_none(), "nginx ended");
            std::thread::sleep(LOOK);
        }
        let origin = format!("https://{address}");
        let sub_path = if below_a_sub_path { "/pinstack" } else { "" };
        Self { process, url: format!("{origin}{sub_path}"), origin }
    }

    /// curl, with what a browser sends for a page of this origin.
    fn curl(&self, folder: &Path) -> Command {
        let mut curl = Command::new("curl");
        curl.current_dir(folder).args(["-sS", "--max-time", "60", "--cacert", "own.pem", "-b", "jar", "-c", "jar"]);
        curl.args(["-H", &format!("Origin: {}", self.origin)]);
        curl
    }

    /// The status, the `Location` and the body of an answer.
    fn answer(&self, folder: &Path, arguments: &[&str], url: &str) -> (u16, String, String) {
        let mut curl = self.curl(folder);
        curl.args(["-o", "body", "-w", "%{http_code} %header{location}"]).args(arguments).arg(url);
        let _ = fs::remove_file(folder.join("body"));
        let told = run(&mut curl);
        let (status, location) = told.split_once(' ').expect("two words");
        let body = fs::read(folder.join("body")).unwrap_or_default();
        (status.parse().expect("a status"), location.to_owned(), String::from_utf8_lossy(&body).into_owned())
    }
}

impl Drop for Nginx {
    fn drop(&mut self) {
        // its master ends its worker
        let id = self.process.id().to_string();
        let _ = Command::new("kill").args(["-TERM", &id]).status();
        let _ = self.process.wait();
    }
}

/// Signs in, sends, follows and deletes as the pages do, and uses a resumable upload.
fn everything_works(below_a_sub_path: bool) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.env("PINSTACK_WORKERS", "0");
    let (server, token) = Server::start_with_a_token_by(command);
    let folder = server.folder.path();
    let nginx = Nginx::start(&server, below_a_sub_path);
    let (base, prefix) = (nginx.url.as_str(), if below_a_sub_path { "/pinstack" } else { "" });
    let at = |path: &str| format!("{base}{path}");
    let ask = |arguments: &[&str], url: &str| nginx.answer(folder, arguments, url);

    let (status, location, _) = ask(&["-H", "Accept: text/html"], &at("/"));
    assert_eq!((status, location), (303, format!("{prefix}/sign-in?next=%2F")));
    let form = format!("token={token}&next=/scans");
    let (status, location, body) = ask(&["-d", &form], &at("/sign-in"));
    assert_eq!((status, location), (303, format!("{prefix}/scans")), "{body}");
    let jar = fs::read_to_string(folder.join("jar")).expect("a cookie");
    let (kind, path) = if below_a_sub_path { ("__Secure-", "/pinstack") } else { ("__Host-", "/") };
    assert!(jar.contains(&format!("{kind}pinstack_token")) && jar.contains(&format!("\t{path}\tTRUE\t")), "{jar}");

    let rig = small_rig();
    let profile = profile_of(&rig).to_string();
    let put = ["-X", "PUT", "-H", "Content-Type: application/json", "-d", &profile];
    assert_eq!(ask(&put, &at("/v1/profiles/rig/lens")).0, 201);
    let zip = ["-X", "POST", "-T", "stack.zip", "-H", "Content-Type: application/zip"];
    write_stack_of(&rig, &folder.join("stack.zip"));
    let (status, location, body) = ask(&zip, &at("/v1/stacks?rig=rig&lens=lens"));
    let stack: Value = serde_json::from_str(&body).unwrap_or_else(|_| panic!("{body}"));
    assert_eq!((status, Some(location.as_str())), (202, stack["links"]["self"].as_str()), "{body}");
    assert!(location.starts_with(&format!("{prefix}/v1/stacks/")), "{location}");

    // an event arrives while the stream goes on
    let stream = format!("{}{location}/events", nginx.origin);
    let mut events = nginx.curl(folder).args(["-N", &stream]).stdout(Stdio::piped()).spawn().expect("curl starts");
    let mut lines = BufReader::new(events.stdout.take().expect("a pipe")).lines();
    assert_eq!(lines.next().expect("a line").expect("text"), "event: state");
    events.kill().and_then(|()| events.wait()).expect("it ended");

    let of = ["-X", "POST", "-H", "Tus-Resumable: 1.0.0", "-H", "Upload-Length: 1000", "-H"];
    let (status, location, body) =
        ask(&[&of[..], &["Upload-Metadata: rig cmln,lens bGVucw=="]].concat(), &at("/v1/uploads"));
    assert!(status == 201 && location.starts_with(&format!("{prefix}/v1/uploads/")), "{status} {location} {body}");
    let upload = format!("{}{location}", nginx.origin);
    assert_eq!(ask(&["-I", "-H", "Tus-Resumable: 1.0.0"], &upload).0, 200);
    assert_eq!(ask(&["-X", "DELETE"], &format!("{}{}", nginx.origin, stack["links"]["self"].as_str().unwrap())).0, 204);
    // a client cannot say where the service is
    let (_, location, _) =
        ask(&["-H", "X-Forwarded-Prefix: /elsewhere", "-H", "Accept: text/html", "-X", "POST"], &at("/sign-out"));
    assert_eq!(location, format!("{prefix}/sign-in"));
}

#[test]
#[ignore = "needs nginx, curl, openssl"]
fn everything_works_behind_nginx_as_documented() {
    everything_works(false);
}

#[test]
#[ignore = "needs nginx, curl, openssl"]
fn everything_works_below_a_sub_path_of_nginx_as_documented() {
    everything_works(true);
}
