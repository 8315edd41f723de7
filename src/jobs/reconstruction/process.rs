//! Runs an outside program under limits of time, memory and disk.
//!
//! The program gets a fixed list of arguments, never a shell, and an environment without the settings of the service.
//! It has a process group of its own, which is killed when the job must stop, when a limit is exceeded, and when the
//! program ends. [`mod@launch`](super::launch) has what the system does besides.

use std::{
    fs::{self, File},
    io::{self, Read, Seek, SeekFrom},
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Child, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

use super::launch::command_of;
use crate::{
    contract::{Code, Fault, JobError},
    jobs::ProgressSink,
    store::is_full,
};

/// Between two looks at the program.
const LOOK: Duration = Duration::from_millis(50);
/// Between two looks at its memory and its files.
const MEASURE: Duration = Duration::from_millis(500);
/// Bytes at the end of the log that an error quotes lines of.
const TAIL: u64 = 4096;
/// Lines of the log that an error quotes.
const QUOTED: usize = 3;

/// What a program may use.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// When it must have ended.
    pub until: Instant,
    /// The whole time up to then, for the error.
    pub time: Duration,
    /// Resident memory, bytes.
    pub memory: u64,
    /// Size of all files in its folder, bytes.
    pub disk: u64,
}

/// Where a program runs.
pub(super) struct Place<'a> {
    /// Its working folder, and that of its temporary files.
    pub folder: &'a Path,
    /// The file to which its output is appended.
    pub log: &'a Path,
    /// What it may use.
    pub limits: Limits,
    /// Tells that the job must stop.
    pub sink: &'a dyn ProgressSink,
}

/// The child and its group, killed when dropped.
struct Group {
    child: Child,
    has_ended: bool,
}

impl Group {
    /// Whether the child has ended. It is not waited for, so that its number stays its own.
    fn is_over(&self) -> io::Result<bool> {
        let ended = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        Ok(waitid(WaitId::Pid(Pid::from_child(&self.child)), ended)?.is_some())
    }

    /// Kills what is left of the group, and waits for the child.
    fn end(&mut self) -> io::Result<ExitStatus> {
        self.has_ended = true;
        // an error means that no process is left but the child, which has ended
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        self.child.wait()
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if !self.has_ended {
            let _ = self.end();
        }
    }
}

impl Place<'_> {
    /// Runs `program`, which errors call `what`, with `arguments` to its end. `on_line` gets each line of its output as
    /// it appears.
    ///
    /// # Errors
    /// [`JobError::Cancelled`] when the job must stop; [`Code::ReconstructionFailed`] when the program fails or exceeds
    /// a limit; [`Code::InsufficientStorage`] when the disk is full; [`Code::Unavailable`] when it cannot be started.
    pub(super) fn run(
        &self,
        program: &Path,
        arguments: &[String],
        what: &str,
        mut on_line: impl FnMut(&str),
    ) -> Result<(), JobError> {
        self.sink.check()?;
        let mut lines = Lines::at_end_of(self.log).map_err(|error| unwritable(&error))?;
        let mut group = Group { child: self.start(program, arguments, what)?, has_ended: false };
        let mut measured = Instant::now();
        while !group.is_over().map_err(|error| unavailable(&error))? {
            lines.read(&mut on_line);
            self.sink.check()?;
            if Instant::now() >= self.limits.until {
                return Err(failed(self.too_long(what)).into());
            }
            if measured.elapsed() >= MEASURE {
                self.measure(&group.child, what)?;
                measured = Instant::now();
            }
            thread::sleep(LOOK);
        }
        let status = group.end().map_err(|error| unavailable(&error))?;
        lines.read(&mut on_line);
        // a program that ends because of a limit may end before it is seen to exceed it
        if self.used() > self.limits.disk {
            return Err(failed(self.too_much_disk(what)).into());
        }
        if status.success() { Ok(()) } else { Err(self.failure(what, status).into()) }
    }

    fn start(&self, program: &Path, arguments: &[String], what: &str) -> Result<Child, JobError> {
        let log = File::options().append(true).open(self.log).map_err(|error| unwritable(&error))?;
        let errors = log.try_clone().map_err(|error| unavailable(&error))?;
        let mut command = command_of(program);
        command.args(arguments).current_dir(self.folder).process_group(0);
        command.env_clear().env("HOME", self.folder).env("TMPDIR", self.folder);
        command.env("LC_ALL", "C.UTF-8").env("QT_QPA_PLATFORM", "offscreen");
        for name in ["PATH", "LD_LIBRARY_PATH"] {
            if let Some(value) = std::env::var_os(name) {
                command.env(name, value);
            }
        }
        command.stdin(Stdio::null()).stdout(log).stderr(errors);
        command.spawn().map_err(|error| {
            tracing::error!(?error, program = %program.display(), "cannot start an outside program");
            let detail = format!("{what} cannot be started ({error}); ask the operator to run `pinstack doctor`");
            Fault::new(Code::Unavailable, detail).into()
        })
    }

    fn measure(&self, child: &Child, what: &str) -> Result<(), Fault> {
        let memory = resident(child);
        if memory > self.limits.memory {
            let (used, most) = (memory >> 20, self.limits.memory >> 20);
            return Err(failed(format!(
                "{what} used {used} MiB of memory, and the jobs may use {most} MiB: raise the setting memory_mb, \
                 or fuse the scan again with a crop"
            )));
        }
        if self.used() > self.limits.disk {
            return Err(failed(self.too_much_disk(what)));
        }
        Ok(())
    }

    fn used(&self) -> u64 {
        size_of(self.folder)
    }

    fn too_long(&self, what: &str) -> String {
        format!(
            "the reconstruction took longer than {} minutes and was stopped during {what}: raise the setting \
             reconstruction_minutes, or leave out views",
            self.limits.time.as_secs().div_ceil(60)
        )
    }

    fn too_much_disk(&self, what: &str) -> String {
        format!(
            "{what} wrote more than the {} MiB that were reserved for these views; the log of the service has more",
            self.limits.disk >> 20
        )
    }

    /// Why a program ended without success.
    fn failure(&self, what: &str, status: ExitStatus) -> Fault {
        let last = last_lines(self.log);
        tracing::warn!(%status, what, last, "an outside program failed");
        let free =
            rustix::fs::statvfs(self.folder).map_or(u64::MAX, |stat| stat.f_bavail.saturating_mul(stat.f_frsize));
        if free < 1 << 20 || last.contains("No space left") || last.contains("disk is full") {
            let detail = format!("the disk of the service is full, so {what} could not go on; free some disk space");
            return Fault::new(Code::InsufficientStorage, detail);
        }
        let said = if last.is_empty() { "it said nothing".to_owned() } else { format!("its last words: {last}") };
        failed(format!("{what} failed ({status}); {said}"))
    }
}

fn failed(detail: String) -> Fault {
    Fault::new(Code::ReconstructionFailed, detail)
}

fn unavailable(error: &io::Error) -> Fault {
    Fault::new(Code::Unavailable, format!("an outside program cannot be run on this machine: {error}"))
}

pub(super) fn unwritable(error: &io::Error) -> Fault {
    let code = if is_full(error) { Code::InsufficientStorage } else { Code::Unavailable };
    Fault::new(
        code,
        format!("the scratch files of a reconstruction cannot be used ({error}); check the disk of the service"),
    )
}

/// Resident memory of all processes of the group of a child, bytes; 0 where the system does not say.
fn resident(child: &Child) -> u64 {
    let group = child.id().to_string();
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes.filter_map(|process| resident_in(&group, &process.path())).sum()
}

/// That of a process, if it is of this group.
fn resident_in(group: &str, process: &Path) -> Option<u64> {
    let stat = fs::read_to_string(process.join("stat")).ok()?;
    // number (name) state parent group ...; the name may have any characters
    if stat.rsplit_once(')')?.1.split_ascii_whitespace().nth(2)? != group {
        return None;
    }
    let status = fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<u64>().ok()? << 10)
}

/// Size of all files below a folder, bytes. Files that vanish meanwhile do not count.
fn size_of(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| match entry.metadata() {
            Ok(found) if found.is_dir() => size_of(&entry.path()),
            Ok(found) => found.len(),
            Err(_) => 0,
        })
        .sum()
}

/// The last lines of a log, as one.
fn last_lines(log: &Path) -> String {
    let mut bytes = Vec::new();
    let read = File::open(log).and_then(|mut file| {
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
        file.read_to_end(&mut bytes)
    });
    if read.is_err() {
        return String::new();
    }
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    lines[lines.len().saturating_sub(QUOTED)..].join(" / ")
}

/// The lines of a file that grows.
struct Lines {
    path: PathBuf,
    at: u64,
    rest: Vec<u8>,
}

impl Lines {
    /// Those after the present end.
    fn at_end_of(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), at: fs::metadata(path)?.len(), rest: Vec::new() })
    }

    /// Gives the new lines to `on_line`. What cannot be read is tried again later.
    fn read(&mut self, on_line: &mut impl FnMut(&str)) {
        let Ok(mut file) = File::open(&self.path) else { return };
        if file.seek(SeekFrom::Start(self.at)).is_err() {
            return;
        }
        if let Ok(read) = file.read_to_end(&mut self.rest) {
            self.at += read as u64;
        }
        while let Some(end) = self.rest.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            on_line(String::from_utf8_lossy(&line).trim_end());
        }
    }
}
