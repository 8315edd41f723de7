//! Runs the program itself, for tests of its settings, signals and log.

use std::{
    path::Path,
    process::{Child, Command, ExitStatus, Stdio},
    time::Duration,
};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

/// Between two looks at a condition.
const LOOK: Duration = Duration::from_millis(5);

/// A running `pinstack serve`, killed when dropped.
pub struct Process {
    child: Child,
    pub base: String,
    pub folder: TempDir,
}

/// `pinstack` with a data folder.
pub fn pinstack(arguments: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.args(arguments).arg("--data-dir").arg(data);
    command
}

impl Process {
    /// Starts the server on a free port.
    pub async fn start(arguments: &[&str]) -> Self {
        Self::start_in(tempfile::tempdir().expect("a folder"), arguments).await
    }

    /// The same on a folder that already contains `data`.
    pub async fn start_in(folder: TempDir, arguments: &[&str]) -> Self {
        let command = pinstack(&[&["serve"], arguments].concat(), &folder.path().join("data"));
        Self::of(command, folder).await
    }

    /// Starts a command that serves, on a free port.
    pub async fn of(mut command: Command, folder: TempDir) -> Self {
        let (port, log) = (folder.path().join("port"), folder.path().join("log"));
        command.args(["--listen", "127.0.0.1:0", "--min-free-bytes", "0", "--port-file"]).arg(&port);
        let log = std::fs::File::create(log).expect("a log");
        let mut child = command.stdout(Stdio::null()).stderr(log).spawn().expect("the program runs");
        let address = loop {
            if let Ok(address) = std::fs::read_to_string(&port) {
                break address;
            }
            assert!(child.try_wait().expect("it can be asked").is_none(), "pinstack serve ended");
            tokio::time::sleep(LOOK).await;
        };
        Self { child, base: format!("http://{}", address.trim()), folder }
    }

    /// The log so far.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).expect("a log")
    }

    /// Waits for a log line that contains all of these.
    pub async fn logged(&self, all: &[&str]) -> String {
        loop {
            let log = self.log();
            if let Some(line) = log.lines().find(|line| all.iter().all(|text| line.contains(text))) {
                return line.to_owned();
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).expect("a signal can be sent");
    }

    /// Waits until the process has ended.
    pub async fn ended(&mut self) -> ExitStatus {
        loop {
            if let Some(status) = self.child.try_wait().expect("it can be asked") {
                return status;
            }
            tokio::time::sleep(LOOK).await;
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
