//! What a handler needs that reads a body itself.

use std::convert::Infallible;

use axum::{
    body::Body,
    extract::{FromRequest, Request},
    http::{HeaderMap, Uri},
};

use super::params;
use crate::http::ApiResult;

/// A request with its body unread.
pub struct Sent {
    /// URL with its query.
    pub uri: Uri,
    /// Headers.
    pub headers: HeaderMap,
    /// The body, as it arrives.
    pub body: Body,
}

impl Sent {
    /// Refuses every query parameter; `instead` says where the data belongs.
    ///
    /// # Errors
    /// `invalid_request`.
    pub fn refuse_query(&self, instead: &str) -> ApiResult<()> {
        params::refuse_rest(&params::pairs(&self.uri)?, &format!("none; {instead}"))
    }
}

impl<S: Send + Sync> FromRequest<S> for Sent {
    type Rejection = Infallible;

    async fn from_request(request: Request, _: &S) -> Result<Self, Infallible> {
        let (parts, body) = request.into_parts();
        Ok(Self { uri: parts.uri, headers: parts.headers, body })
    }
}
