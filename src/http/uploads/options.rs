//! `OPTIONS /v1/uploads`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode},
    response::{IntoResponse, Response},
};

use super::{
    checksum::ALGORITHMS,
    protocol::{TUS_CHECKSUM_ALGORITHM, TUS_EXTENSION, TUS_MAX_SIZE, TUS_VERSION, VERSION},
};
use crate::http::App;

/// Supported extensions of tus.
const EXTENSIONS: &str = "creation,creation-with-upload,checksum,termination,expiration";

/// Get the capabilities of resumable uploads
///
/// tus 1.0.0: the response has no body; its headers list extensions and limits.
#[utoipa::path(
    options,
    path = "/v1/uploads",
    operation_id = "get_upload_options",
    tag = "uploads",
    responses((status = 204, description = "Version, extensions and limits", headers(
        ("Tus-Version" = String, description = "`1.0.0`"),
        ("Tus-Extension" = String, description = "Supported extensions"),
        ("Tus-Max-Size" = u64, description = "Largest upload of any purpose, bytes"),
        ("Tus-Checksum-Algorithm" = String, description = "`sha1,sha256`"))))
)]
pub async fn options(State(app): State<App>) -> Response {
    let headers = HeaderMap::from_iter([
        (TUS_VERSION, VERSION),
        (TUS_EXTENSION, HeaderValue::from_static(EXTENSIONS)),
        (TUS_MAX_SIZE, HeaderValue::from(app.policy.max_upload_bytes.max(app.policy.max_scan_bytes))),
        (TUS_CHECKSUM_ALGORITHM, HeaderValue::from_static(ALGORITHMS)),
    ]);
    (StatusCode::NO_CONTENT, headers).into_response()
}
