//! Work beside a request, on another task or thread: its log lines carry the request too. Nothing else in this floor starts
//! tasks, so that no line is without its request id.

use tokio::task::JoinHandle;
use tracing::{Instrument, Span};

/// Starts a task.
pub fn spawn<F>(work: F) -> JoinHandle<F::Output>
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    tokio::spawn(work.in_current_span())
}

/// Starts work that blocks its thread.
pub fn spawn_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> JoinHandle<T> {
    let span = Span::current();
    tokio::task::spawn_blocking(move || span.in_scope(work))
}
