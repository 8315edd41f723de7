//! `Idempotency-Key`: a repeat of a request answers the job that the first one made.

use axum::http::{HeaderMap, HeaderName};
use sha2::{Digest, Sha256};

use super::spool::hex;
use crate::{
    contract::{Code, JobKind},
    http::{
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::Job,
};

/// The request header.
pub const IDEMPOTENCY_KEY: HeaderName = HeaderName::from_static("idempotency-key");
/// `true` on an answer that shows an earlier job.
pub const IDEMPOTENCY_REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// The key of a request.
///
/// # Errors
/// `invalid_request` unless it is 1 to 255 printable characters.
pub fn key(headers: &HeaderMap) -> ApiResult<Option<String>> {
    let Some(value) = headers.get(IDEMPOTENCY_KEY) else { return Ok(None) };
    let text = value.to_str().unwrap_or_default().trim();
    if (1..=255).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic() || b == b' ') {
        return Ok(Some(text.to_owned()));
    }
    let detail = "Idempotency-Key must be 1 to 255 printable ASCII characters";
    Err(ApiError::new(Code::InvalidRequest, detail))
}

/// The key as the row has it. Where tokens see only their own stacks, each has keys of its own: a key that somebody else
/// used must not lead to their stack. A blank before it keeps them apart, because no key begins with one.
pub fn of_caller(key: String, owner: Option<uuid::Uuid>) -> String {
    match owner {
        Some(owner) => format!(" {owner} {key}"),
        None => key,
    }
}

/// What makes two requests the same: kind, names, options and the bytes of the zip.
pub fn fingerprint(kind: JobKind, asked: &serde_json::Value, sha256: &str) -> String {
    let text = serde_json::json!({ "kind": kind, "asked": asked, "sha256": sha256 }).to_string();
    hex(&Sha256::digest(text))
}

/// The job that this key made before, if the request is the same.
///
/// # Errors
/// `idempotency_key_reused` when the key came with another request.
pub async fn earlier(app: &App, key: &str, fingerprint: &str) -> ApiResult<Option<Job>> {
    match app.rows.by_idempotency_key(key).await? {
        None => Ok(None),
        Some((job, first)) if first == fingerprint => Ok(Some(job)),
        Some(_) => Err(reused(key)),
    }
}

/// The key came with another request.
pub fn reused(key: &str) -> ApiError {
    // without whose it is: the client does not know that part
    let key = key.strip_prefix(' ').and_then(|key| key.split_once(' ')).map_or(key, |(_, key)| key);
    let detail = format!(
        "the Idempotency-Key '{key}' was used before with another rig, lens, options or file; use a new key per stack"
    );
    ApiError::new(Code::IdempotencyKeyReused, detail)
}
