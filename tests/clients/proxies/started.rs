//! Starts a proxy with the configuration of the documentation.

use std::{
    fs,
    net::{TcpListener, TcpStream},
    path::PathBuf,
    process::{Child, Command},
};

use tempfile::TempDir;

use crate::{
    run,
    server::{LOOK, Server},
    tls::certificate,
};

/// How the block for a path of a shared host is joined with the other one.
#[derive(Clone, Copy)]
enum Path {
    /// It is complete.
    Whole,
    /// Its lines replace those with the same directives.
    Lines,
    /// It replaces as many lines at the end.
    Last(usize),
}

/// A program, and what a test changes in the documented configuration. In all texts `{folder}`, `{port}`, `{server}`
/// (its URL) and `{address}` (its host and port) are replaced.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Its name, and that of the language of its blocks in the documentation.
    pub name: &'static str,
    /// Whether a client that speaks HTTP/1.1 gets a refusal while it sends: Caddy closes its connection early.
    refuses_by_http_1: bool,
    path: Path,
    before: &'static str,
    after: &'static str,
    /// What is documented, and what the test has in its place. Host names are those of both blocks.
    own: &'static [(&'static str, &'static str)],
    command: &'static [&'static str],
}

pub const NGINX: Kind = Kind {
    name: "nginx",
    refuses_by_http_1: true,
    path: Path::Lines,
    before: "daemon off;\npid {folder}/pid;\nevents {}\nhttp {\naccess_log off;\nclient_body_temp_path {folder}/a;\n\
             proxy_temp_path {folder}/b;\nfastcgi_temp_path {folder}/c;\nuwsgi_temp_path {folder}/d;\n\
             scgi_temp_path {folder}/e;\n",
    after: "\n}\n",
    own: &[
        ("listen 443 ssl http2;", "listen 127.0.0.1:{port} ssl http2;"),
        ("/etc/ssl/certs/{host}.pem", "{folder}/own.pem"),
        ("/etc/ssl/private/{host}.key", "{folder}/own.key"),
        ("http://127.0.0.1:8080", "{server}"),
    ],
    command: &["nginx", "-c", "{folder}/conf", "-e", "{folder}/log"],
};

pub const CADDY: Kind = Kind {
    name: "caddy",
    refuses_by_http_1: false,
    path: Path::Whole,
    before: "{\nadmin off\nauto_https disable_redirects\nstorage file_system {folder}\ndefault_bind 127.0.0.1\n}\n",
    after: "\n",
    own: &[
        ("{host} {", "{host}:{port} {"),
        ("/etc/ssl/certs/{host}.pem", "{folder}/own.pem"),
        ("/etc/ssl/private/{host}.key", "{folder}/own.key"),
        ("127.0.0.1:8080", "{address}"),
    ],
    command: &["caddy", "run", "--config", "{folder}/conf", "--adapter", "caddyfile"],
};

pub const HAPROXY: Kind = Kind {
    name: "haproxy",
    refuses_by_http_1: true,
    path: Path::Last(4),
    before: "global\n    maxconn 500\n",
    after: "\n",
    own: &[
        ("bind :443 ssl crt /etc/haproxy/pinstack.example.pem", "bind 127.0.0.1:{port} ssl crt {folder}/both.pem"),
        ("127.0.0.1:8080", "{address}"),
    ],
    command: &["haproxy", "-db", "-f", "{folder}/conf"],
};

pub const APACHE: Kind = Kind {
    name: "apache",
    refuses_by_http_1: true,
    path: Path::Lines,
    before: "ServerRoot /usr/lib/apache2\nPidFile {folder}/pid\nErrorLog {folder}/log\nDefaultRuntimeDir {folder}\n\
             LoadModule mpm_event_module modules/mod_mpm_event.so\n\
             LoadModule authz_core_module modules/mod_authz_core.so\n\
             LoadModule ssl_module modules/mod_ssl.so\nLoadModule http2_module modules/mod_http2.so\n\
             LoadModule headers_module modules/mod_headers.so\nLoadModule proxy_module modules/mod_proxy.so\n\
             LoadModule proxy_http_module modules/mod_proxy_http.so\nLoadModule reqtimeout_module modules/mod_reqtimeout.so\n\
             User daemon\nGroup daemon\nListen 127.0.0.1:{port}\n",
    after: "\n",
    own: &[
        ("*:443", "127.0.0.1:{port}"),
        ("/etc/ssl/certs/{host}.pem", "{folder}/own.pem"),
        ("/etc/ssl/private/{host}.key", "{folder}/own.key"),
        ("http://127.0.0.1:8080/", "{server}/"),
    ],
    command: &["apache2", "-D", "FOREGROUND", "-f", "{folder}/conf"],
};

/// The block of the documentation that begins with this line.
fn documented(fence: &str) -> String {
    let page = include_str!("../../../docs/PROXIES.md");
    let block = page.split(&format!("\n```{fence}\n")).nth(1).unwrap_or_else(|| panic!("{fence} is not documented"));
    block.split("\n```").next().expect("it ends").to_owned()
}

/// The name of a directive, and the header that it sets or removes if it does.
fn directive(line: &str) -> Vec<&str> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["proxy_set_header", header, ..] => vec![words[0], header],
        ["RequestHeader", _, header, ..] => vec![words[0], header],
        _ => words[..words.len().min(1)].to_vec(),
    }
}

/// The documented configuration of a host, or of a path of a shared host.
fn configuration(kind: &Kind, at_a_path: bool) -> String {
    let whole = documented(kind.name);
    if !at_a_path {
        return whole;
    }
    let changed = documented(&format!("{} path", kind.name));
    let mut lines: Vec<&str> = whole.lines().collect();
    match kind.path {
        Path::Whole => return changed,
        Path::Last(count) => {
            lines.truncate(lines.len() - count);
            lines.push(&changed);
        }
        Path::Lines => {
            for new in changed.lines() {
                let same = |line: &&mut &str| !line.trim().is_empty() && directive(line) == directive(new);
                *lines.iter_mut().find(same).unwrap_or_else(|| panic!("{new} changes no line")) = new;
            }
        }
    }
    lines.join("\n")
}

/// A running proxy, ended when dropped.
pub struct Proxy {
    process: Child,
    kind: Kind,
    /// Its host, another one than that of the service.
    pub host: &'static str,
    pub port: u16,
    /// The path of the service on that host.
    pub prefix: &'static str,
    folder: TempDir,
}

impl Proxy {
    pub fn start(kind: &Kind, server: &Server, at_a_path: bool) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        certificate(at, "own");
        let both = ["own.pem", "own.key"].map(|name| fs::read_to_string(at.join(name)).expect("a file")).concat();
        fs::write(at.join("both.pem"), both).expect("a file");
        let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
        let documented = configuration(kind, at_a_path);
        // the second blocks of some are lines for the first
        let host = if documented.contains("lab.example ") { "lab.example" } else { "pinstack.example" };
        let address = server.url.strip_prefix("http://").expect("a URL");
        let fill = |text: &str| {
            let text = text.replace("{folder}", at.to_str().expect("UTF-8")).replace("{port}", &port.to_string());
            text.replace("{server}", &server.url).replace("{address}", address).replace("{host}", host)
        };
        let mut site = documented;
        for (old, own) in kind.own {
            let old = fill(old);
            assert!(site.contains(&old), "{old} is not in the documentation of {}", kind.name);
            site = site.replace(&old, &fill(own));
        }
        let whole = format!("{}{site}{}", fill(kind.before), kind.after);
        fs::write(at.join("conf"), whole).expect("the folder can be written");
        let words: Vec<String> = kind.command.iter().map(|word| fill(word)).collect();
        let told = fs::File::create(at.join("told")).expect("a file");
        let mut command = Command::new(&words[0]);
        // Caddy writes its configuration there once more
        command.env("XDG_CONFIG_HOME", at);
        let mut process = command.args(&words[1..]).stderr(told).spawn().expect("the proxy starts");
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            let told = || fs::read_to_string(at.join("told")).unwrap_or_default();
            assert!(process.try_wait().expect("it can be asked").is_none(), "{} ended: {}", kind.name, told());
            std::thread::sleep(LOOK);
        }
        Self { process, kind: *kind, host, port, prefix: if at_a_path { "/pinstack" } else { "" }, folder }
    }

    /// Its origin, as browsers write it.
    pub fn origin(&self) -> String {
        format!("https://{}:{}", self.host, self.port)
    }

    /// The address of a path of the service.
    pub fn at(&self, path: &str) -> String {
        format!("{}{}{path}", self.origin(), self.prefix)
    }

    /// The versions of HTTP by which a client gets a refusal while it sends.
    pub fn versions_of_refusals(&self) -> &'static [&'static str] {
        if self.kind.refuses_by_http_1 { &["--http1.1", "--http2"] } else { &["--http2"] }
    }

    /// A file of its folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// curl, with what a browser sends for a page of this origin.
    pub fn curl(&self) -> Command {
        let mut curl = Command::new("curl");
        curl.current_dir(self.folder.path());
        curl.args(["-sS", "--max-time", "300", "--cacert", "own.pem", "-b", "jar", "-c", "jar"]);
        curl.args(["--resolve", &format!("{}:{}:127.0.0.1", self.host, self.port)]);
        curl.args(["-H", &format!("Origin: {}", self.origin())]);
        curl
    }

    /// The status, the `Location` and the body of an answer.
    pub fn ask(&self, arguments: &[&str], url: &str) -> (u16, String, String) {
        let mut curl = self.curl();
        curl.args(["-o", "body", "-w", "%{http_code} %header{location}"]).args(arguments).arg(url);
        let _ = fs::remove_file(self.file("body"));
        let told = run(&mut curl);
        let (status, location) = told.split_once(' ').expect("two words");
        let body = fs::read(self.file("body")).unwrap_or_default();
        (status.parse().expect("a status"), location.to_owned(), String::from_utf8_lossy(&body).into_owned())
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        // a master ends its workers
        let _ = Command::new("kill").args(["-TERM", &self.process.id().to_string()]).status();
        let _ = self.process.wait();
    }
}
