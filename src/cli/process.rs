//! The life of a process that serves or works: it ends by a signal.

use std::time::Duration;

use tokio::signal::unix::{Signal, SignalKind, signal};

use super::logging;

/// How long running jobs may take to end after the shutdown begins. Then they return to the queue.
pub(super) const GRACE: Duration = Duration::from_secs(5);

/// Exit code when a second signal ends the process at once: that of a process killed by SIGTERM.
const ENDED_BY_SIGNAL: i32 = 143;

/// SIGTERM and SIGINT.
pub(super) struct StopSignals {
    terminate: Signal,
    interrupt: Signal,
}

impl StopSignals {
    pub(super) fn listen() -> anyhow::Result<Self> {
        Ok(Self { terminate: signal(SignalKind::terminate())?, interrupt: signal(SignalKind::interrupt())? })
    }

    /// Waits for the next signal.
    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = self.terminate.recv() => {}
            _ = self.interrupt.recv() => {}
        }
    }

    /// Waits for a signal, then for the end of `shutdown`. A second signal ends the process at once.
    pub(super) async fn end_by<T>(mut self, shutdown: impl Future<Output = T>) -> T {
        self.next().await;
        tracing::info!("shutting down; a second signal ends the process at once");
        tokio::select! {
            ended = shutdown => ended,
            () = self.next() => {
                tracing::warn!("the process ends at once; another process, or the next one, resumes the jobs that were running");
                logging::flush();
                std::process::exit(ENDED_BY_SIGNAL)
            }
        }
    }
}
