//! Tasks that must not end while the process runs: workers, garbage collection, the accept loop, and what polls or
//! listens for all requests. A panic ends such a task, and without it the service would seem to run and do nothing.

use std::{
    any::Any,
    panic::AssertUnwindSafe,
    time::{Duration, Instant},
};

use futures::FutureExt;

use crate::telemetry::events;

/// Pause after the first panic; doubled after each further one.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
/// Longest pause. A task that ran for longer than this begins with the first pause again.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// Runs a task, and starts it again after a panic. Returns when the task returns.
///
/// ```
/// # let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
/// let starts = std::sync::atomic::AtomicUsize::new(0);
/// let task = || async { assert!(starts.fetch_add(1, std::sync::atomic::Ordering::Relaxed) == 1, "a bug") };
/// runtime.block_on(pinstack::supervision::supervised("worker", task));
/// assert_eq!(starts.into_inner(), 2);
/// ```
pub async fn supervised<F: Future<Output = ()>>(name: &'static str, start: impl Fn() -> F) {
    let mut pause = FIRST_PAUSE;
    events::task_panicked(name, 0);
    loop {
        let started = Instant::now();
        // nothing of the task is used again: what it shares with others is behind locks that survive a panic
        let Err(panic) = AssertUnwindSafe(async { start().await }).catch_unwind().await else { return };
        if started.elapsed() > LONGEST_PAUSE {
            pause = FIRST_PAUSE;
        }
        tracing::error!(task = name, panic = message(&*panic), ?pause, "a task panicked; it starts again");
        events::task_panicked(name, 1);
        tokio::time::sleep(pause).await;
        pause = (2 * pause).min(LONGEST_PAUSE);
    }
}

/// What a panic says.
pub fn message(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message")
}
