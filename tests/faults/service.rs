//! A process of the service that can be broken.

use std::{
    path::Path,
    process::{Child, Command, ExitStatus, Output, Stdio},
    time::Duration,
};

use rustix::process::{Pid, Signal, kill_process};
use tokio::time::sleep;

/// Between two looks at a condition.
pub const LOOK: Duration = Duration::from_millis(10);

/// A running `pinstack serve`; killed when dropped.
pub struct Service {
    process: Child,
    pub url: String,
}

fn pinstack() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.env_remove("FAILPOINTS").stdin(Stdio::null());
    // spans are sent at once, where they are sent at all
    command.env("OTEL_BSP_SCHEDULE_DELAY", "50").env("OTEL_RESOURCE_ATTRIBUTES", "deployment.environment.name=test");
    command
}

/// What a command said.
pub fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Collects garbage and verifies the store by the command that `run` runs: nothing is left over, and every file is what
/// its row says. Returns what the verification said.
pub fn verified(run: impl Fn(&[&str]) -> Output) -> String {
    let collected = run(&["gc", "--grace-s", "0"]);
    assert!(collected.status.success(), "{}", text(&collected));
    let verified = run(&["verify"]);
    let said = text(&verified);
    assert!(verified.status.success() && said.contains("; files of 0 unknown jobs"), "{said}");
    said
}

/// Runs a command of `pinstack` on a data folder, to its end.
pub fn command(data: &Path, arguments: &[&str]) -> Output {
    pinstack().args(arguments).arg("--data-dir").arg(data).output().expect("pinstack starts")
}

/// The same, with its rows in Postgres.
pub fn command_on(database: &str, data: &Path, arguments: &[&str]) -> Output {
    let mut command = pinstack();
    command.env("PINSTACK_DATABASE_URL", database).args(arguments).arg("--data-dir").arg(data);
    command.output().expect("pinstack starts")
}

/// The same with both.
pub fn armed_command_on(database: &str, data: &Path, arguments: &[&str], fault: &str) -> Output {
    let mut command = pinstack();
    command.env("PINSTACK_DATABASE_URL", database).env("FAILPOINTS", fault).args(arguments);
    command.arg("--data-dir").arg(data).output().expect("pinstack starts")
}

/// The same, broken where `fault` says.
pub fn armed_command(data: &Path, arguments: &[&str], fault: &str) -> Output {
    let mut command = pinstack();
    command.env("FAILPOINTS", fault).args(arguments).arg("--data-dir").arg(data);
    command.output().expect("pinstack starts")
}

/// The same, not waited for.
pub fn armed_child(data: &Path, arguments: &[&str], fault: &str) -> Child {
    let mut command = pinstack();
    command.env("FAILPOINTS", fault).args(arguments).arg("--data-dir").arg(data);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("pinstack starts")
}

/// True while a process is stopped by a signal.
pub fn is_stopped(process: &Child) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.id())).unwrap_or_default();
    // after the name in parentheses, which may hold blanks
    stat.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('T'))
}

/// Deletes what has expired, including the zips of stacks that succeeded.
pub fn clean_up(data: &Path, fault: Option<&str>) -> Output {
    let mut command = pinstack();
    command.env("PINSTACK_KEEP_UPLOADS_DAYS", "0").env("FAILPOINTS", fault.unwrap_or_default());
    command.args(["gc", "--data-dir"]).arg(data).output().expect("pinstack starts")
}

/// The log beside a data folder.
fn log_beside(data: &Path) -> std::fs::File {
    std::fs::File::options().create(true).append(true).open(data.with_extension("log")).expect("a log")
}

impl Service {
    /// Starts one; it breaks where `fault` says, in the language of the crate `fail`. `None`: it was killed before it
    /// listened.
    pub async fn start(data: &Path, fault: Option<&str>, more: &[&str]) -> Option<Self> {
        Self::start_with_log(data, log_beside(data), fault, more).await
    }

    /// The same with another place for the log.
    pub async fn start_with_log(
        data: &Path,
        log: impl Into<Stdio>,
        fault: Option<&str>,
        more: &[&str],
    ) -> Option<Self> {
        let port = data.with_extension(format!("port-{}", uuid::Uuid::now_v7()));
        let mut command = pinstack();
        command.args(["serve", "--listen", "127.0.0.1:0", "--lease-s", "2", "--min-free-bytes", "0", "--data-dir"]);
        command.arg(data).arg("--port-file").arg(&port).args(more).stdout(Stdio::null()).stderr(log);
        if let Some(fault) = fault {
            command.env("FAILPOINTS", fault);
        }
        let mut process = command.spawn().expect("pinstack starts");
        loop {
            if let Ok(address) = std::fs::read_to_string(&port) {
                return Some(Self { process, url: format!("http://{}", address.trim()) });
            }
            if let Some(status) = process.try_wait().expect("it can be asked") {
                // what it said, in case it was expected to listen; tests show it only where they fail
                let said = std::fs::read_to_string(data.with_extension("log")).unwrap_or_default();
                println!("pinstack ended before it listened, with {status}:\n{said}");
                return None;
            }
            sleep(LOOK).await;
        }
    }

    /// Starts a process that runs jobs and has no address.
    pub fn start_worker(data: &Path, fault: Option<&str>, more: &[&str]) -> Self {
        Self::start_worker_with_log(data, log_beside(data), fault, more)
    }

    /// The same with another place for the log.
    pub fn start_worker_with_log(data: &Path, log: impl Into<Stdio>, fault: Option<&str>, more: &[&str]) -> Self {
        let mut command = pinstack();
        command.args(["work", "--lease-s", "2", "--min-free-bytes", "0", "--data-dir"]).arg(data).args(more);
        if let Some(fault) = fault {
            command.env("FAILPOINTS", fault);
        }
        let process = command.stdout(Stdio::null()).stderr(log).spawn().expect("pinstack starts");
        Self { process, url: String::new() }
    }

    /// Waits for its end.
    pub async fn ended(&mut self) -> ExitStatus {
        loop {
            if let Some(status) = self.process.try_wait().expect("it can be asked") {
                return status;
            }
            sleep(LOOK).await;
        }
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.process), signal).expect("a signal can be sent");
    }

    /// True while it is stopped by a signal.
    pub fn is_stopped(&self) -> bool {
        is_stopped(&self.process)
    }

    /// Files and sockets that it has open.
    pub fn descriptors(&self) -> usize {
        std::fs::read_dir(format!("/proc/{}/fd", self.process.id())).expect("it lives").count()
    }

    /// The most memory that it had at a time, kB.
    pub fn peak_memory_kb(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).expect("it lives");
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("Linux says so");
        peak.trim().trim_end_matches(" kB").parse().expect("a number")
    }

    /// Ends it politely.
    pub async fn stop(mut self) {
        self.signal(Signal::TERM);
        let status = self.ended().await;
        assert!(status.success(), "it did not end well: {status}");
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
