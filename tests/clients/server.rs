//! A service process for one test, and the slices to send to it.

use std::{
    fs,
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

use pinstack_science::{
    imaging::codec,
    synth::{Light, Rig, Scene, Stage},
};
use serde_json::Value;
use tempfile::TempDir;

use crate::run;

/// Between two looks at a condition.
pub const LOOK: Duration = Duration::from_millis(5);

/// A running `pinstack serve`, killed when dropped.
pub struct Server {
    process: Child,
    pub url: String,
    pub folder: TempDir,
}

impl Server {
    /// Starts a server on a free port with an empty data folder and waits until it answers.
    pub fn start() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (process, url) = serve(&folder);
        Self { process, url, folder }
    }

    /// The same, with nothing that runs jobs.
    pub fn start_without_workers() -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
        command.env("PINSTACK_WORKERS", "0");
        Self::start_by(command)
    }

    /// The same, started by this command.
    pub fn start_by(command: Command) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (process, url) = serve_by(command, &folder);
        Self { process, url, folder }
    }

    /// The same, requiring this token, which has all rights.
    pub fn start_with_a_token() -> (Self, String) {
        Self::start_with_a_token_by(Command::new(env!("CARGO_BIN_EXE_pinstack")))
    }

    /// The same, started by this command.
    fn start_with_a_token_by(command: Command) -> (Self, String) {
        let folder = tempfile::tempdir().expect("a folder");
        let token = run(Command::new(env!("CARGO_BIN_EXE_pinstack"))
            .args(["token", "add", "tester", "--scope", "admin", "--data-dir"])
            .arg(folder.path().join("data")));
        let (process, url) = serve_by(command, &folder);
        (Self { process, url, folder }, token.trim().to_owned())
    }

    /// The same, with a trace of all system calls that write, sync, rename or answer in the file `trace` of its folder.
    pub fn start_traced() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut strace = Command::new("strace");
        strace.args(["-D", "-f", "-y", "-s", "16", "-e"]);
        strace.arg("trace=write,pwrite64,writev,sendto,sendmsg,fsync,fdatasync,rename,renameat,renameat2");
        strace.arg("-o").arg(folder.path().join("trace")).arg(env!("CARGO_BIN_EXE_pinstack"));
        let (process, url) = serve_by(strace, &folder);
        Self { process, url, folder }
    }

    /// Kills the process (SIGKILL) and starts another on the same data.
    pub fn kill_and_start_again(&mut self) {
        self.process.kill().expect("it can be killed");
        self.process.wait().expect("it ended");
        (self.process, self.url) = serve(&self.folder);
    }

    /// The same, by another command.
    pub fn start_again_by(&mut self, command: Command) {
        self.process.kill().expect("it can be killed");
        self.process.wait().expect("it ended");
        (self.process, self.url) = serve_by(command, &self.folder);
    }

    /// The answer that curl gets, as JSON.
    pub fn curl(&self, arguments: &[&str], path: &str) -> Value {
        let url = format!("{}{path}", self.url);
        let text = run(Command::new("curl").args(["-sS", "--max-time", "120"]).args(arguments).arg(&url));
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{url} did not answer with JSON ({e}): {text}"))
    }

    /// The answer that curl gets, as a file.
    pub fn download(&self, arguments: &[&str], path: &str, file: &Path) {
        let url = format!("{}{path}", self.url);
        run(Command::new("curl")
            .args(["-sS", "--fail", "--max-time", "120", "-o"])
            .arg(file)
            .args(arguments)
            .arg(&url));
    }

    /// Stores the true homographies of `rig` as a profile.
    pub fn put_profile(&self, rig: &Rig) {
        let body = profile_of(rig).to_string();
        let profile =
            self.curl(&["-X", "PUT", "-H", "Content-Type: application/json", "-d", &body], "/v1/profiles/rig/lens");
        assert_eq!(profile["revision"], 1, "{profile}");
    }

    /// Sends a zip and waits for the finished stack.
    pub fn fuse(&self, zip: &Path, query: &str) -> Value {
        let zip = zip.to_str().expect("a plain path");
        let arguments = ["-X", "POST", "-T", zip, "-H", "Content-Type: application/zip", "-H", "Prefer: wait=60"];
        self.curl(&arguments, &format!("/v1/stacks?rig=rig&lens=lens{query}"))
    }

    /// Waits for the end of a job by its event stream, which ends with it.
    pub fn finished(&self, job: &Value) -> Value {
        let path = job["links"]["self"].as_str().unwrap_or_else(|| panic!("refused: {job}"));
        let events = format!("{}{path}/events", self.url);
        run(Command::new("curl").args(["-sS", "--max-time", "600", "-N", &events]));
        self.curl(&[], path)
    }
}

fn serve(folder: &TempDir) -> (Child, String) {
    serve_by(Command::new(env!("CARGO_BIN_EXE_pinstack")), folder)
}

fn serve_by(mut command: Command, folder: &TempDir) -> (Child, String) {
    let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
    let address = format!("127.0.0.1:{port}");
    let mut process = command
        .args(["serve", "--listen", &address, "--data-dir"])
        .arg(folder.path().join("data"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("pinstack starts");
    while TcpStream::connect(&address).is_err() {
        assert!(process.try_wait().expect("it can be asked").is_none(), "pinstack serve ended");
        std::thread::sleep(LOOK);
    }
    (process, format!("http://{address}"))
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The true homographies of a rig, as `PUT` takes a profile.
pub fn profile_of(rig: &Rig) -> Value {
    serde_json::json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": (0..rig.slices()).map(|i| rig.homography(i)).collect::<Vec<_>>(),
        "gains": (0..rig.slices()).map(|i| rig.gain(i)).collect::<Vec<_>>(),
    })
}

/// A small rig that renders fast.
pub fn small_rig() -> Rig {
    Rig::sized(240, 160, 4)
}

/// Writes the slices of a small stack as `front/img_1.jpg`, ... and `back/img_1.jpg`, ...
pub fn write_slices(folder: &Path) {
    let rig = small_rig();
    let stage = Stage::new(&rig, &Scene::insect(1));
    for (name, light) in [("front", Light::Front), ("back", Light::Back)] {
        fs::create_dir_all(folder.join(name)).expect("a folder");
        for i in 0..rig.slices() {
            let jpeg = codec::encode_jpeg(&stage.render(light, i), 92);
            fs::write(folder.join(name).join(format!("img_{}.jpg", i + 1)), jpeg).expect("a slice");
        }
    }
}

/// Renders both lights of `rig` into a zip.
pub fn write_stack_of(rig: &Rig, zip: &Path) {
    let stage = Stage::new(rig, &Scene::plates(1));
    let members = [("front", Light::Front), ("back", Light::Back)].into_iter().flat_map(|(folder, light)| {
        let stage = &stage;
        (0..rig.slices())
            .map(move |i| (format!("{folder}/{i:02}.jpg"), codec::encode_jpeg(&stage.render(light, i), 92)))
    });
    pinstack_science::archive::pack(fs::File::create(zip).expect("a file"), members).expect("a zip");
}
