//! `Idempotency-Key`: a request that repeats an earlier one gets the job of the first.
//!
//! Two requests are the same when their fingerprints are: SHA-256 of the kind of job, rig, lens, options and the
//! SHA-256 of the zip. The same key with another fingerprint is refused.

use axum::http::{HeaderMap, HeaderName};
use serde::Serialize;
use sha2::{Digest, Sha256};
use uuid::Uuid;

use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App, auth::Caller},
    store::{Job, digest::hex},
};

/// The request header.
pub const IDEMPOTENCY_KEY: HeaderName = HeaderName::from_static("idempotency-key");
/// `true` in a response that shows an earlier job.
pub const IDEMPOTENCY_REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// The `Idempotency-Key` of a request, if it has one.
#[derive(Debug, Clone)]
pub struct IdempotencyKey {
    /// The key as the store keeps it.
    pub stored: Option<String>,
    /// True when an earlier request with this key made a job. Such a request makes no new job and takes nothing from
    /// a quota or the queue.
    pub is_repeat: bool,
}

impl IdempotencyKey {
    /// The key of a request, and whether it was used before.
    ///
    /// # Errors
    /// `invalid_request` unless the key is 1 to 255 printable characters.
    pub async fn of_request(app: &App, caller: &Caller, headers: &HeaderMap) -> ApiResult<Self> {
        let stored = parse(headers)?.map(|key| of_owner(key, caller.sees_only(app)));
        let is_repeat = match &stored {
            Some(key) => app.store.metadata.by_idempotency_key(key).await?.is_some(),
            None => false,
        };
        Ok(Self { stored, is_repeat })
    }
}

/// The header, if the request has it.
///
/// # Errors
/// `invalid_request` unless it is 1 to 255 printable characters.
pub fn parse(headers: &HeaderMap) -> ApiResult<Option<String>> {
    let Some(value) = headers.get(IDEMPOTENCY_KEY) else { return Ok(None) };
    let text = value.to_str().unwrap_or_default().trim();
    if (1..=255).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic() || b == b' ') {
        return Ok(Some(text.to_owned()));
    }
    let detail = "Idempotency-Key must be 1 to 255 printable ASCII characters";
    Err(ApiError::new(Code::InvalidRequest, detail))
}

/// The key as the store keeps it. Where tokens see only their own stacks, each token has keys of its own: a key that
/// another token used must not lead to that token's stack. Such a key is prefixed with a space and the id of the token;
/// no key of a client begins with a space.
fn of_owner(key: String, owner: Option<Uuid>) -> String {
    match owner {
        Some(owner) => format!(" {owner} {key}"),
        None => key,
    }
}

/// The fingerprint of a submission of this kind with this zip; `asked` is what the client asked for.
pub fn fingerprint(kind: impl Serialize, asked: impl Serialize, sha256: &str) -> String {
    // the member `asked` keeps its name: stored fingerprints contain it
    let document = serde_json::json!({ "kind": kind, "asked": asked, "sha256": sha256 });
    hex(&Sha256::digest(document.to_string()))
}

/// The job that an earlier request with this key made, if the request is the same.
///
/// # Errors
/// `idempotency_key_reused` when the key came with another request.
pub async fn earlier(app: &App, key: &str, fingerprint: &str) -> ApiResult<Option<Job>> {
    match app.store.metadata.by_idempotency_key(key).await? {
        None => Ok(None),
        Some((job, first)) if first == fingerprint => Ok(Some(job)),
        Some(_) => Err(reused(key)),
    }
}

/// The error for a key that was used with another request. `key` is as the store keeps it.
pub fn reused(key: &str) -> ApiError {
    // without the owner, which the client does not know
    let key = key.strip_prefix(' ').and_then(|key| key.split_once(' ')).map_or(key, |(_, key)| key);
    let detail = format!(
        "the Idempotency-Key '{key}' was used before with another rig, lens, options or file; use a new key per stack"
    );
    ApiError::new(Code::IdempotencyKeyReused, detail)
}
