//! URLs of this service in answers: links of documents and pages, `Location`, redirects, problem types.
//!
//! A proxy may publish the service below a sub-path. Each request is then handled [`within`] that sub-path, which the
//! layer [`prefix`](super::middleware::prefix) found, and `link!` is the only way to write a URL: `tests/project`
//! refuses a path that is written without it.

use std::sync::Arc;

tokio::task_local! {
    static PREFIX: Arc<str>;
}

/// The sub-path of the service for the client of this request, such as `/pinstack`; empty at the root of its host.
pub fn prefix() -> Arc<str> {
    PREFIX.try_with(Arc::clone).unwrap_or_default()
}

/// Does work for a client that sees the service below this sub-path.
pub fn within<F: Future>(prefix: Arc<str>, work: F) -> impl Future<Output = F::Output> {
    PREFIX.scope(prefix, work)
}

/// Work of this request for another task.
pub fn carried<F: Future>(work: F) -> impl Future<Output = F::Output> {
    within(prefix(), work)
}

/// Work of this request for another thread.
pub fn carried_by_thread<T>(work: impl FnOnce() -> T) -> impl FnOnce() -> T {
    let prefix = prefix();
    move || PREFIX.sync_scope(prefix, work)
}

/// The URL of a path of this service, as the client of this request reaches it. Takes the arguments of `format!`.
macro_rules! link {
    ($($path:tt)*) => {
        format!("{}{}", $crate::http::links::prefix(), format_args!($($path)*))
    };
}
