//! Progress of the work on a terminal, and the wish to stop it.

use std::{
    io::{self, IsTerminal, Write},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use crate::{
    cli::{output::note, process::StopSignals},
    contract::Progress,
    http::pages::words::duration,
    jobs::ProgressSink,
};
use pinstack_science::types::{Cancelled, Control};

/// Cells of the bar.
const CELLS: usize = 24;
/// How often the bar is drawn.
const DRAWN: Duration = Duration::from_millis(100);
/// Fraction of the work, and time, after which the time that is left is told.
const TOLD: (f64, Duration) = (0.02, Duration::from_secs(2));
/// Exit code when a second signal ends the process at once: that of a process killed by SIGINT.
const ENDED_BY_SIGNAL: i32 = 130;

/// A signal arrived.
static STOPPED: AtomicBool = AtomicBool::new(false);

/// From now on a signal stops the work, and a second one ends the process at once.
///
/// # Errors
/// When signals cannot be listened to.
pub(in crate::cli) fn stop_by_signals(runtime: &tokio::runtime::Runtime) -> anyhow::Result<()> {
    let _inside = runtime.enter();
    let mut signals = StopSignals::listen()?;
    runtime.spawn(async move {
        signals.next().await;
        STOPPED.store(true, Ordering::Relaxed);
        signals.next().await;
        std::process::exit(ENDED_BY_SIGNAL);
    });
    Ok(())
}

/// Whether a signal has stopped the work.
pub(in crate::cli) fn is_stopped() -> bool {
    STOPPED.load(Ordering::Relaxed)
}

/// The progress of a run of several jobs: a bar with the time that is left on a terminal, else a line per stage.
pub(in crate::cli) struct Bar {
    is_terminal: bool,
    jobs: usize,
    begun: Instant,
    state: Mutex<State>,
}

struct State {
    /// Jobs that have ended.
    ended: usize,
    /// The job that runs.
    job: String,
    stage: String,
    drawn: Option<Instant>,
}

impl Bar {
    /// For a run of `jobs` jobs.
    pub(in crate::cli) fn new(jobs: usize) -> Self {
        let state = State { ended: 0, job: String::new(), stage: String::new(), drawn: None };
        Self { is_terminal: io::stderr().is_terminal(), jobs, begun: Instant::now(), state: Mutex::new(state) }
    }

    /// The next job begins.
    pub(in crate::cli) fn begin(&self, job: &str) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        (state.job, state.stage) = (job.to_owned(), String::new());
    }

    /// The job has ended, well or not.
    pub(in crate::cli) fn end(&self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).ended += 1;
        self.clear();
    }

    /// Removes the bar, before other lines.
    pub(in crate::cli) fn clear(&self) {
        if self.is_terminal {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}

impl ProgressSink for Bar {
    fn report(&self, progress: Progress) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.is_terminal {
            if state.stage != progress.stage {
                note(format!("{}: {}", state.job, progress.stage));
                state.stage = progress.stage;
            }
            return;
        }
        if state.drawn.is_some_and(|drawn| drawn.elapsed() < DRAWN) {
            return;
        }
        state.drawn = Some(Instant::now());
        let number = if self.jobs > 1 { format!("[{}/{}] ", state.ended + 1, self.jobs) } else { String::new() };
        let left = left(self.begun.elapsed(), (state.ended as f64 + progress.fraction) / self.jobs.max(1) as f64);
        let (bar, percent) = (bar(progress.fraction), 100.0 * progress.fraction);
        let line = format!("\r{number}{} {bar} {percent:3.0} %  {}{left}\x1b[K", state.job, progress.stage);
        let mut terminal = io::stderr();
        let _ = terminal.write_all(line.as_bytes()).and_then(|()| terminal.flush());
    }

    fn check(&self) -> Result<(), Cancelled> {
        if is_stopped() { Err(Cancelled) } else { Ok(()) }
    }
}

/// What is read before a job runs belongs to no fraction of it.
impl Control for Bar {
    fn progress(&self, stage: &'static str, completed: usize, total: usize) {
        let number = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let (completed, total) = (number(completed), number(total));
        self.report(Progress { stage: stage.to_owned(), completed, total, fraction: 0.0 });
    }

    fn check(&self) -> Result<(), Cancelled> {
        ProgressSink::check(self)
    }
}

fn bar(fraction: f64) -> String {
    let full = ((fraction * CELLS as f64) as usize).min(CELLS);
    format!("{}{}", "█".repeat(full), "░".repeat(CELLS - full))
}

/// The time that is left when `fraction` of all work has taken `passed`; empty while it is unknown.
fn left(passed: Duration, fraction: f64) -> String {
    if fraction < TOLD.0 || passed < TOLD.1 {
        return String::new();
    }
    let left = passed.mul_f64((1.0 - fraction).max(0.0) / fraction);
    format!(", about {} left", duration(left))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_is_full_at_the_end_and_the_time_left_is_that_of_the_rest() {
        assert_eq!((bar(0.0), bar(1.0)), ("░".repeat(CELLS), "█".repeat(CELLS)));
        assert_eq!(bar(0.5).chars().filter(|c| *c == '█').count(), CELLS / 2);
        assert_eq!(left(Duration::from_secs(10), 0.25), ", about 30 s left");
        assert_eq!(
            (left(Duration::from_secs(1), 0.5), left(Duration::from_secs(9), 0.0)),
            (String::new(), String::new())
        );
    }
}
