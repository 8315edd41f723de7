//! `X-Request-Id`: keeps the id of the client or makes one, and adds it to the request, to its log lines and to the
//! answer. `X-Forwarded-For` of a client that is no trusted proxy is removed, so that what follows can believe it.

use std::sync::Arc;

use axum::{
    extract::Request,
    http::{HeaderName, HeaderValue},
    middleware::Next,
    response::Response,
};
use uuid::Uuid;

use crate::http::{connections::Seat, log};

/// The header.
pub const X_REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id of a client that is accepted.
const MAX_LENGTH: usize = 128;

/// The layer.
pub async fn keep_or_make(mut request: Request, next: Next) -> Response {
    let given = request.headers().get(&X_REQUEST_ID).filter(|id| is_printable(id)).cloned();
    let id = given.unwrap_or_else(make);
    let seat = request.extensions().get::<Arc<Seat>>();
    let client = seat.map(|seat| seat.client(request.headers()));
    let is_of_proxy = seat.is_some_and(|seat| seat.is_of_proxy());
    if !is_of_proxy {
        request.headers_mut().remove("x-forwarded-for");
    }
    request.headers_mut().insert(X_REQUEST_ID, id.clone());
    let span = log::span(id.to_str().unwrap_or_default(), client);
    let mut response = log::within(span, next.run(request)).await;
    response.headers_mut().insert(X_REQUEST_ID, id);
    response
}

/// The id is copied into a header and into the log, so only short printable text is accepted.
fn is_printable(id: &HeaderValue) -> bool {
    (1..=MAX_LENGTH).contains(&id.len()) && id.as_bytes().iter().all(u8::is_ascii_graphic)
}

fn make() -> HeaderValue {
    HeaderValue::from_str(&Uuid::now_v7().to_string()).unwrap_or_else(|_| HeaderValue::from_static("unknown"))
}
