//! A Postgres server for tests. Other tests of the project include this file too.
//!
//! The server is that of `PINSTACK_TEST_POSTGRES_URL`, or a private one from the programs of Debian's `postgresql`, in
//! a temporary folder, on a Unix socket. It ends with the process of the tests, however that ends: a shell waits for
//! the end of its input.

use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{ChildStdin, Command, Stdio},
    sync::OnceLock,
};

/// Postgres refuses to run as root, so root runs it as the user that the package creates.
const SCRIPT: &str = r#"
set -e
bin=$1
folder=$(mktemp -d /tmp/pinstack-postgres-XXXXXX)
if [ "$(id -u)" = 0 ]; then
  chown postgres "$folder"
  user="setpriv --reuid=postgres --regid=postgres --clear-groups"
else
  user=""
fi
as() { $user "$@"; }
cd "$folder"
as "$bin/initdb" -D "$folder/data" -U postgres -A trust -E UTF8 --no-sync >"$folder/log" 2>&1
as "$bin/pg_ctl" -D "$folder/data" -w -l "$folder/server.log" \
  -o "-c listen_addresses= -c unix_socket_directories=$folder -c fsync=off -c max_connections=600" start >/dev/null
printf 'cd %s; %s "%s/pg_ctl" -D data -w -m fast -l server.log restart >/dev/null' "$folder" "$user" "$bin" >"$folder/restart"
echo "$folder"
cat >/dev/null
as "$bin/pg_ctl" -D "$folder/data" -m immediate stop >/dev/null || true
rm -rf "$folder"
"#;

/// A running server. A private one ends when the pipe is closed.
pub(super) struct Server {
    pub(super) url: String,
    /// The folder of the private server.
    folder: PathBuf,
    _pipe: Option<ChildStdin>,
}

impl Server {
    /// A private server of the caller alone.
    ///
    /// # Panics
    /// When Postgres is not installed, or does not start.
    pub(super) fn private() -> Self {
        start(&programs().expect("postgresql is not installed, and PINSTACK_TEST_POSTGRES_URL is not set"))
    }

    /// Ends every session and starts the server again, as an operator does.
    #[allow(dead_code, reason = "not every test that includes this file restarts its server")]
    pub(super) fn restart(&self) {
        let script = self.folder.join("restart");
        let done = Command::new("sh").arg(script).output().expect("a shell");
        assert!(done.status.success(), "{done:?}");
    }
}

/// The URL of the server, which is started by the first caller.
///
/// # Panics
/// When there is none, or it does not start.
pub(super) fn url() -> &'static str {
    static SERVER: OnceLock<Server> = OnceLock::new();
    let start = || match std::env::var("PINSTACK_TEST_POSTGRES_URL") {
        Ok(url) => Server { url, folder: PathBuf::new(), _pipe: None },
        Err(_) => Server::private(),
    };
    &SERVER.get_or_init(start).url
}

#[expect(clippy::zombie_processes, reason = "the shell ends with this process, when its input is closed")]
fn start(programs: &Path) -> Server {
    let mut shell = Command::new("sh")
        .args(["-c", SCRIPT, "sh"])
        .arg(programs)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("a shell");
    let mut folder = String::new();
    BufReader::new(shell.stdout.take().expect("piped")).read_line(&mut folder).expect("the shell writes a line");
    assert!(folder.starts_with('/'), "the Postgres server for tests did not start");
    let folder = folder.trim();
    let url = format!("postgres://postgres@localhost/postgres?host={folder}");
    Server { url, folder: folder.into(), _pipe: shell.stdin.take() }
}

/// The folder of `initdb`: Debian keeps one per version, outside of `PATH`.
fn programs() -> Option<PathBuf> {
    let debian = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    let debian = debian.map(|version| version.path().join("bin"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders: Vec<PathBuf> = debian.chain(std::env::split_paths(&path)).collect();
    folders.retain(|folder| folder.join("initdb").is_file() && folder.join("pg_ctl").is_file());
    folders.sort();
    folders.pop()
}

/// The URL of a schema of its own, which does not exist yet, and its name.
pub(super) fn in_schema(url: &str) -> (String, String) {
    let name = format!("test_{}", uuid::Uuid::now_v7().simple());
    let join = if url.contains('?') { '&' } else { '?' };
    (format!("{url}{join}options[search_path]={name}"), name)
}
