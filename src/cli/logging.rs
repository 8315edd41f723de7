//! The log, written to stderr: text for a terminal, or one JSON object per line for a collector.
//!
//! A thread of its own writes the lines. What logs never waits for it and never fails: stderr may be a pipe that no one
//! reads any more, or a file on a full disk. Lines that cannot be written are dropped and counted; later lines are
//! written once stderr works again. Panics are logged too, by their hook.

use std::{
    backtrace::{Backtrace, BacktraceStatus},
    fs::File,
    io::{self, IsTerminal, Write},
    os::fd::AsFd,
    panic,
    sync::{
        OnceLock,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread,
    time::Duration,
};

use anyhow::{Context, anyhow};
use tracing::field;
use tracing_subscriber::{
    filter::{LevelFilter, Targets},
    fmt,
    layer::SubscriberExt,
    util::SubscriberInitExt,
};

use super::output::note;
use crate::{settings::LogFormat, telemetry::events};

/// Lines that wait to be written. More are dropped.
const WAITING: usize = 8192;
/// How long the end of the process waits for the lines that wait.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(1);

/// The lines of this process, once it logs.
static LINES: OnceLock<SyncSender<Entry>> = OnceLock::new();

/// What waits for the thread that writes.
enum Entry {
    /// A whole line.
    Line(Vec<u8>),
    /// A caller waits for the end of the lines before it.
    Flush(SyncSender<()>),
}

/// Tells that the process has begun its work: in a line without a time, or in the log where programs read it.
pub fn announce(format: LogFormat, line: &str) {
    match format {
        LogFormat::Text => note(line),
        LogFormat::Json => tracing::info!("{line}"),
    }
}

/// Starts logging. `filter` is a level, or levels by crate or module: `info`, `info,pinstack=debug`, ...
///
/// # Errors
/// When the filter is not valid, or no thread can be started.
pub fn start(filter: &str, format: LogFormat) -> anyhow::Result<()> {
    let filter = filter_of(filter)?;
    // colours only on a terminal, not in a file or a collector
    let colours = std::io::stderr().is_terminal();
    let lines = start_writing().context("log: cannot be written to the standard error")?;
    let log = fmt()
        .with_max_level(LevelFilter::TRACE)
        .with_writer(move || OneLine { to: Queue(lines.clone()), colours })
        .with_ansi(colours);
    // fails if logging was started before (by another service in this process), which then stays as it is
    let _ = match format {
        LogFormat::Text => log.with_target(false).finish().with(filter).try_init(),
        // an event is within one span at most (`request` or `job`), so the list of spans would repeat it
        LogFormat::Json => log.json().with_span_list(false).finish().with(filter).try_init(),
    };
    panic::set_hook(Box::new(|panic| {
        let backtrace = Backtrace::capture();
        let backtrace = (backtrace.status() == BacktraceStatus::Captured).then(|| field::display(backtrace));
        tracing::error!(%panic, backtrace, "panicked");
    }));
    Ok(())
}

/// Waits until what was logged is written, but not long: stderr may hang.
pub fn flush() {
    let Some(lines) = LINES.get() else { return };
    let (flushed, wait) = sync_channel(1);
    // a full queue is not being written
    if lines.try_send(Entry::Flush(flushed)).is_ok() {
        let _ = wait.recv_timeout(FLUSH_TIMEOUT);
    }
}

/// Starts the thread that writes to stderr, once.
fn start_writing() -> io::Result<SyncSender<Entry>> {
    if let Some(lines) = LINES.get() {
        return Ok(lines.clone());
    }
    // without the lock of `io::stderr`, which others take, and which would be held while a pipe is full
    let stderr = File::from(io::stderr().as_fd().try_clone_to_owned()?);
    let (lines, entries) = sync_channel(WAITING);
    thread::Builder::new().name("log".into()).spawn(move || write_all(stderr, &entries))?;
    Ok(LINES.get_or_init(|| lines).clone())
}

/// Writes what arrives.
fn write_all(mut to: impl Write, entries: &Receiver<Entry>) {
    let mut is_torn = false;
    for entry in entries {
        match entry {
            Entry::Line(line) => {
                // a full disk may have taken the beginning of a line
                let begun = if is_torn { to.write_all(b"\n") } else { Ok(()) };
                is_torn = begun.and_then(|()| to.write_all(&line)).is_err();
                if is_torn {
                    events::log_line_lost();
                }
            }
            Entry::Flush(flushed) => _ = flushed.try_send(()),
        }
    }
}

/// The lines that wait.
struct Queue(SyncSender<Entry>);

impl Write for Queue {
    /// `line` is a whole line. It is never an error that it cannot be written.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if self.0.try_send(Entry::Line(line.to_vec())).is_err() {
            events::log_line_lost();
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The filter that the setting `log` describes.
fn filter_of(setting: &str) -> anyhow::Result<Targets> {
    setting.parse().map_err(|error| {
        anyhow!(
            "log: '{setting}' is not a log filter ({error}); use a level (error, warn, info, debug, trace, off), or \
             levels by module such as info,pinstack=debug"
        )
    })
}

/// Writes each event as one line: line ends inside it (for example in text from a client) and other control characters
/// are escaped.
struct OneLine<W> {
    to: W,
    /// Keep escape characters, which begin colour codes.
    colours: bool,
}

impl<W: Write> Write for OneLine<W> {
    /// `event` is a whole event: `tracing-subscriber` writes each with one call.
    fn write(&mut self, event: &[u8]) -> io::Result<usize> {
        let (text, end) = match event.strip_suffix(b"\n") {
            Some(text) => (text, &b"\n"[..]),
            None => (event, &b""[..]),
        };
        let is_kept = |byte: u8| !byte.is_ascii_control() || (byte == 0x1b && self.colours);
        let mut line = Vec::with_capacity(event.len());
        for &byte in text {
            if is_kept(byte) { line.push(byte) } else { line.extend(byte.escape_ascii()) }
        }
        line.extend(end);
        self.to.write_all(&line)?;
        Ok(event.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_is_a_level_or_levels_by_module() {
        let enabled = |setting: &str, target: &str, level: tracing::Level| {
            filter_of(setting).expect("a filter").would_enable(target, &level)
        };
        assert!(enabled("info", "pinstack::http", tracing::Level::INFO));
        assert!(!enabled("info", "pinstack::http", tracing::Level::DEBUG));
        assert!(enabled("info,pinstack=debug", "pinstack::http", tracing::Level::DEBUG));
        assert!(!enabled("info,pinstack=debug", "sqlx", tracing::Level::DEBUG));
        assert!(!enabled("off", "pinstack", tracing::Level::ERROR));
        let refused = filter_of("pinstack=loud").expect_err("no such level").to_string();
        assert!(refused.contains("pinstack=loud") && refused.contains("info,pinstack=debug"), "{refused}");
    }

    /// A disk with space for some bytes.
    struct Disk {
        space: std::rc::Rc<std::cell::Cell<usize>>,
        written: std::rc::Rc<std::cell::RefCell<Vec<u8>>>,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let fits = bytes.len().min(self.space.get());
            self.space.set(self.space.get() - fits);
            self.written.borrow_mut().extend(&bytes[..fits]);
            if fits == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(fits) }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn lines_that_do_not_fit_are_dropped_and_later_ones_are_written_whole() {
        let (space, written) = (std::rc::Rc::new(std::cell::Cell::new(7)), std::rc::Rc::default());
        let log = |lines: &[&str]| {
            let (sender, entries) = sync_channel(8);
            let mut queue = Queue(sender);
            lines.iter().for_each(|line| queue.write_all(line.as_bytes()).expect("it never fails"));
            drop(queue);
            entries
        };
        let entries = log(&["a\n", "bcdefgh\n", "lost\n"]);
        let disk = || Disk { space: space.clone(), written: std::rc::Rc::clone(&written) };
        write_all(disk(), &entries);
        assert_eq!(*written.borrow(), b"a\nbcdef");
        let (sender, entries) = sync_channel(8);
        for line in ["lost", "whole\n"] {
            sender.try_send(Entry::Line(line.into())).expect("it waits");
        }
        drop(sender);
        // the disk has space again after the first of these lines
        struct Freed(Disk);
        impl Write for Freed {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                let written = self.0.write(bytes);
                if written.is_err() {
                    self.0.space.set(100);
                }
                written
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        write_all(Freed(disk()), &entries);
        assert_eq!(*written.borrow(), b"a\nbcdef\nwhole\n");
    }

    #[test]
    fn a_log_that_is_not_written_makes_no_one_wait() {
        let (sender, entries) = sync_channel(2);
        let mut queue = Queue(sender);
        for _ in 0..100 {
            queue.write_all(b"a line\n").expect("it never fails");
        }
        drop(queue);
        assert_eq!(entries.iter().count(), 2);
    }

    #[test]
    fn an_event_is_one_line_whatever_it_contains() {
        let written = |colours: bool, event: &str| {
            let mut out = OneLine { to: Vec::new(), colours };
            out.write_all(event.as_bytes()).expect("memory can be written");
            String::from_utf8(out.to).expect("UTF-8")
        };
        assert_eq!(written(false, "a Käfer\nERROR b\r\u{1b}[31m\n"), "a Käfer\\nERROR b\\r\\x1b[31m\n");
        assert_eq!(written(true, "\u{1b}[32mINFO\u{1b}[0m a\tb\n"), "\u{1b}[32mINFO\u{1b}[0m a\\tb\n");
    }
}
