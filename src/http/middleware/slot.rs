//! A connection without a slot is asked for its health alone.

use std::sync::Arc;

use axum::{
    extract::Request,
    http::{HeaderValue, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::Code,
    http::{connections::Seat, problem::ApiError},
};

/// The layer. A request that came over no connection (a test's) needs no slot.
pub async fn require(request: Request, next: Next) -> Response {
    let Some(seat) = request.extensions().get::<Arc<Seat>>().cloned() else { return next.run(request).await };
    seat.asked();
    let is_about_health = ["/healthz", "/readyz"].contains(&request.uri().path());
    if is_about_health || seat.got_slot().await {
        return next.run(request).await;
    }
    let detail = "all connections that the service takes at a time are in use, or all that one address may have; try again \
                  later, over fewer connections";
    let refused = ApiError::new(Code::Unavailable, detail);
    refused.with_header(header::CONNECTION, HeaderValue::from_static("close")).into_response()
}
