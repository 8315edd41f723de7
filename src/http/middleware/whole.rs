//! Refuses bodies that are encoded, or a part of a file. Both would be taken for a damaged file otherwise.

use axum::{
    extract::Request,
    http::{HeaderMap, HeaderValue, Method, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, one_line},
    http::{ApiError, ingest::body::discard},
};

/// Characters of a header that the answer repeats.
const SHOWN: usize = 40;

/// The layer: a body with a `Content-Encoding` gets 415 with the codings that are accepted, none (RFC 9110, section
/// 15.5.16); one with the `Content-Range` of a part gets 400 (section 14.5).
pub async fn refuse_others(request: Request, next: Next) -> Response {
    let refusal = match *request.method() {
        Method::GET | Method::HEAD => None,
        _ => encoded(request.headers()).or_else(|| partial(request.headers())),
    };
    let Some(refusal) = refusal else { return next.run(request).await };
    let (parts, body) = request.into_parts();
    discard(&parts.headers, body);
    refusal.into_response()
}

/// The text of a header, shortened.
fn shown(value: &HeaderValue) -> String {
    one_line(&String::from_utf8_lossy(value.as_bytes()).trim().chars().take(SHOWN).collect::<String>())
}

fn encoded(headers: &HeaderMap) -> Option<ApiError> {
    let is_coded = |coding: &String| !coding.is_empty() && !coding.eq_ignore_ascii_case("identity");
    let coding = headers.get_all(header::CONTENT_ENCODING).iter().map(shown).find(is_coded)?;
    let detail = format!("the body is encoded (Content-Encoding: {coding}), which is not supported; send it as it is");
    let error = ApiError::new(Code::UnsupportedMediaType, detail);
    Some(error.with_header(header::ACCEPT_ENCODING, HeaderValue::from_static("identity")))
}

fn partial(headers: &HeaderMap) -> Option<ApiError> {
    let range = shown(headers.get(header::CONTENT_RANGE)?);
    let is_whole = || {
        let (first_last, length) = range.strip_prefix("bytes ")?.split_once('/')?;
        let (first, last) = first_last.split_once('-')?;
        Some(first == "0" && last.parse::<u64>().ok()?.checked_add(1)? == length.parse::<u64>().ok()?)
    };
    if is_whole() == Some(true) {
        return None;
    }
    let detail = format!(
        "the body is a part of a file (Content-Range: {range}), as curl -C sends it, and parts cannot be joined here; send \
         the whole file, or use /v1/uploads (tus), which continues an upload that broke off"
    );
    Some(ApiError::new(Code::InvalidRequest, detail))
}
