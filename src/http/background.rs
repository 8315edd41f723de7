//! Background tasks and blocking work of requests. Their log lines have the fields of the request, their steps are
//! spans of its trace, and their links are those of its client. All tasks that a request starts begin here, except the
//! one that polls for waiting requests ([`super::state::job_watch`]), so that no log line lacks its request id.

use tokio::task::JoinHandle;
use tracing::{Instrument, Span};

use super::{ApiError, ApiResult, links};
use crate::telemetry::traces;

/// Starts a task in the span of the request.
#[expect(clippy::disallowed_methods, reason = "this is where the request goes along")]
pub fn spawn<F>(work: F) -> JoinHandle<F::Output>
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    tokio::spawn(traces::carried(links::carried(work)).in_current_span())
}

/// Does work to its end, also when the client disconnects and the future of its request is dropped.
///
/// # Errors
/// Those of the work; `internal` when it panics.
pub async fn to_the_end<T: Send + 'static>(work: impl Future<Output = ApiResult<T>> + Send + 'static) -> ApiResult<T> {
    spawn(work).await.map_err(ApiError::internal)?
}

/// Starts blocking work on a thread of its own, in the span of the request.
#[expect(clippy::disallowed_methods, reason = "this is where the request goes along")]
pub fn spawn_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> JoinHandle<T> {
    let (span, work) = (Span::current(), traces::carried_by_thread(links::carried_by_thread(work)));
    tokio::task::spawn_blocking(move || span.in_scope(work))
}

/// Runs blocking work on a thread of its own.
///
/// # Errors
/// `internal` when the work panics.
pub async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> ApiResult<T> {
    spawn_blocking(work).await.map_err(ApiError::internal)
}

/// Runs blocking work that keeps `held`, such as a permit or a file, until it ends. A client that disconnects drops the
/// future of its request, but the work goes on.
///
/// # Errors
/// `internal` when the work panics.
pub async fn blocking_with<H: Send + 'static, T: Send + 'static>(
    held: H,
    work: impl FnOnce(&H) -> T + Send + 'static,
) -> ApiResult<T> {
    blocking(move || work(&held)).await
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, mpsc};

    use tokio::sync::{Semaphore, oneshot};

    use super::*;

    #[tokio::test]
    async fn a_client_that_disconnects_frees_nothing_before_the_work_has_ended() {
        let permits = Arc::new(Semaphore::new(1));
        let permit = permits.clone().acquire_owned().await.expect("a permit");
        let (started, has_started) = oneshot::channel();
        let (end, may_end) = mpsc::channel::<()>();
        let request = spawn(blocking_with(permit, move |_| {
            started.send(()).expect("the test waits");
            may_end.recv().ok()
        }));
        has_started.await.expect("the work begins");
        request.abort();
        assert!(request.await.expect_err("the client is gone").is_cancelled());
        assert_eq!(permits.available_permits(), 0, "the work goes on");
        end.send(()).expect("the work waits");
        // returns when the work has ended
        drop(permits.acquire().await.expect("a permit"));
    }
}
