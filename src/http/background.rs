//! Background tasks and blocking work of requests. Their log lines have the fields of the request, and their steps are
//! spans of its trace. All tasks that a request starts begin here, except the one that polls for waiting requests
//! ([`super::watch`]), so that no log line lacks its request id.

use tokio::task::JoinHandle;
use tracing::{Instrument, Span};

use crate::telemetry::traces;

/// Starts a task in the span of the request.
pub fn spawn<F>(work: F) -> JoinHandle<F::Output>
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    tokio::spawn(traces::carried(work).in_current_span())
}

/// Runs blocking work on a thread of its own, in the span of the request.
pub fn spawn_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> JoinHandle<T> {
    let (span, work) = (Span::current(), traces::carried_by_thread(work));
    tokio::task::spawn_blocking(move || span.in_scope(work))
}
