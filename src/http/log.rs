//! What every line of the log says of the request it belongs to.
//!
//! The span `request` ([`span`]) carries the request id and the client from the start; [`note`] adds what becomes known
//! later: the token, the rig, the lens, the job. Lines of work that goes on beside the request carry it too
//! ([`super::background`]).

use std::{cell::RefCell, fmt::Display, net::IpAddr};

use tracing::{Instrument, Span, field};

tokio::task_local! {
    /// Names that [`note`] has added.
    static NOTED: RefCell<Vec<String>>;
}

/// The span of a request. An error span: whatever the filter lets through, its lines have the request id.
pub fn span(id: &str, client: Option<IpAddr>) -> Span {
    let span = tracing::error_span!(
        "request",
        id,
        client = field::Empty,
        token = field::Empty,
        rig = field::Empty,
        lens = field::Empty,
        upload = field::Empty,
        job = field::Empty
    );
    if let Some(client) = client {
        span.record("client", field::display(client));
    }
    span
}

/// Answers a request within its span.
pub async fn within<F: Future>(span: Span, answering: F) -> F::Output {
    NOTED.scope(RefCell::default(), answering.instrument(span)).await
}

/// Adds to the lines of this request from here on. `name` is one of the fields of [`span`]; `value` must not hold control
/// characters (ids, and names that were checked, do not). The first value of a name stays.
pub fn note(name: &str, value: impl Display) {
    let is_new = NOTED.try_with(|noted| {
        let mut noted = noted.borrow_mut();
        let is_new = !noted.iter().any(|earlier| earlier == name);
        if is_new {
            noted.push(name.to_owned());
        }
        is_new
    });
    // work beside the request does not know what was noted
    if is_new.unwrap_or(true) {
        Span::current().record(name, field::display(value));
    }
}
