//! What every line of the log says of the request it belongs to.
//!
//! The span `request` ([`span`]) carries the request id and the client from the start; [`note`] adds what becomes known
//! later: the token, the rig, the lens, the job. Lines of work that goes on beside the request carry it too
//! ([`super::background`]).

use std::{fmt::Display, net::IpAddr};

use tracing::{Span, field};

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

/// Adds to the lines of this request from here on. `name` is one of the fields of [`span`]; `value` must not hold control
/// characters (ids, and names that were checked, do not).
pub fn note(name: &str, value: impl Display) {
    Span::current().record(name, field::display(value));
}
