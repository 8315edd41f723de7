//! `X-Forwarded-Prefix`: the sub-path below which a trusted proxy publishes the service, and which it removes from the
//! URL of each request.

use std::sync::Arc;

use axum::{extract::Request, middleware::Next, response::Response};

use crate::http::{connections::Seat, links};

/// The layer: every URL in the answer begins with the prefix.
pub async fn enter(request: Request, next: Next) -> Response {
    let prefix = request.extensions().get::<Arc<Seat>>().and_then(|seat| seat.prefix(request.headers()));
    links::within(prefix.unwrap_or_default(), next.run(request)).await
}
