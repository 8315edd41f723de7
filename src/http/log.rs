//! The fields of a request that each of its log lines has.
//!
//! The span `request` ([`span`]) has the request id and the client from the start; [`note`] adds what becomes known
//! later: token, rig, lens, scan, upload, job, trace_id. Tasks that a request starts log within the same span
//! ([`super::background`]).

use std::{cell::RefCell, fmt::Display, net::IpAddr};

use tracing::{Instrument, Span, field};

tokio::task_local! {
    /// Names that [`note`] has added.
    static NOTED: RefCell<Vec<String>>;
}

/// The span of a request. Its level is `error`, so that the log filter never removes the request id.
pub fn span(id: &str, client: Option<IpAddr>) -> Span {
    let span = tracing::error_span!(
        "request",
        id,
        client = field::Empty,
        token = field::Empty,
        rig = field::Empty,
        lens = field::Empty,
        scan = field::Empty,
        upload = field::Empty,
        job = field::Empty,
        trace_id = field::Empty
    );
    if let Some(client) = client {
        span.record("client", field::display(client));
    }
    span
}

/// Runs a request within its span.
pub async fn within<F: Future>(span: Span, answering: F) -> F::Output {
    NOTED.scope(RefCell::default(), answering.instrument(span)).await
}

/// Adds a field to the following log lines of this request. `name` is a field of [`span`]; `value` must not contain
/// control characters (ids and checked names do not). The first value of a name is kept.
pub fn note(name: &str, value: impl Display) {
    let is_new = NOTED.try_with(|noted| {
        let mut noted = noted.borrow_mut();
        let is_new = !noted.iter().any(|earlier| earlier == name);
        if is_new {
            noted.push(name.to_owned());
        }
        is_new
    });
    // background tasks do not have the task-local
    if is_new.unwrap_or(true) {
        Span::current().record(name, field::display(value));
    }
}
