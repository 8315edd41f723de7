//! What commands print. Unlike `println!`, nothing here panics when it cannot be written: a terminal was closed, a
//! reader such as `head` has seen enough, or the disk is full.

use std::{
    fmt::Display,
    io::{self, Write},
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::{Context, bail};

/// A line of a result could not be written.
static INCOMPLETE: AtomicBool = AtomicBool::new(false);

/// Prints a line of the result of a command. The work of the command goes on if it cannot be written, and
/// [`require_complete`] reports it.
pub fn say(line: impl Display) {
    match write_line(&mut io::stdout(), line) {
        // the reader has seen enough
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
        Err(_) => INCOMPLETE.store(true, Ordering::Relaxed),
        Ok(()) => {}
    }
}

/// Prints a line that is never shown again.
///
/// # Errors
/// When it cannot be written.
pub fn say_once(line: impl Display) -> anyhow::Result<()> {
    write_line(&mut io::stdout(), line).context("cannot write to the standard output")
}

/// Tells what goes on, on stderr.
pub fn note(line: impl Display) {
    let _ = write_line(&mut io::stderr(), line);
}

/// Requires that the whole result was written.
///
/// # Errors
/// When a line was not.
pub fn require_complete() -> anyhow::Result<()> {
    if INCOMPLETE.load(Ordering::Relaxed) {
        bail!("the work is done, but its result could not be written to the standard output");
    }
    Ok(())
}

fn write_line(to: &mut impl Write, line: impl Display) -> io::Result<()> {
    // one call, so that lines of other threads do not mix with it
    to.write_all(format!("{line}\n").as_bytes())?;
    to.flush()
}
