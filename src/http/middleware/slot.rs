//! Connections without a slot may only request the health endpoints.

use std::sync::Arc;

use axum::{
    extract::Request,
    http::{HeaderValue, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::Code,
    http::{ApiError, connections::Seat, ingest::body::discard},
};

/// The layer. A request without a connection (in tests) needs no slot.
pub async fn require(request: Request, next: Next) -> Response {
    let Some(seat) = request.extensions().get::<Arc<Seat>>().cloned() else { return next.run(request).await };
    seat.note_request();
    let is_about_health = ["/healthz", "/readyz"].contains(&request.uri().path());
    if is_about_health || seat.got_slot().await {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    discard(&parts.headers, body);
    let detail = "the limit of connections of the service or of this address is reached; try again later, over fewer \
                  connections";
    let refused = ApiError::new(Code::Unavailable, detail);
    refused.with_header(header::CONNECTION, HeaderValue::from_static("close")).into_response()
}
