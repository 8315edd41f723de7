//! What is known before the body is read: its length, the room on the disk, the length of the queue.

use axum::http::{HeaderMap, header};

use super::body::too_large;
use crate::{
    http::{
        problem::{ApiError, ApiResult},
        state::{App, Promise},
    },
    model::Code,
};

/// What a form may have around the zip itself.
pub const FORM_OVERHEAD: u64 = 1 << 20;

/// Lets an upload in, or says why not. `job_bytes` is what the job of it may write; it is looked for, not promised: a job
/// waits for its room. The promise holds the room of the upload until it is written or dropped.
///
/// # Errors
/// `upload_too_large`, `insufficient_storage` with figures, `queue_full`.
pub async fn admit(
    app: &App,
    headers: &HeaderMap,
    max_bytes: u64,
    is_repeat: bool,
    job_bytes: u64,
) -> ApiResult<Promise> {
    let length = content_length(headers);
    if length.is_some_and(|length| length > max_bytes) {
        return Err(too_large(app.policy.max_upload_bytes).into());
    }
    let length = length.unwrap_or(0);
    require_room(app, length, job_bytes).await?;
    // a repeat makes no new job
    if !is_repeat {
        let waiting = app.rows.counts().await?.queued;
        if waiting >= app.policy.queue_limit {
            return Err(queue_full(waiting));
        }
    }
    Ok(app.promise(length))
}

/// Checks that an upload of `bytes` and `job_bytes` of its job can be written, next to what other uploads were promised and what must stay free.
///
/// # Errors
/// `insufficient_storage` with figures.
pub async fn require_room(app: &App, bytes: u64, job_bytes: u64) -> ApiResult<()> {
    let room = app.blobs.room().await?.free;
    let promised = app.promised_bytes().saturating_add(app.rows.awaited_bytes().await?);
    let reserve = app.policy.min_free_bytes;
    if room >= bytes.saturating_add(job_bytes).saturating_add(promised).saturating_add(reserve) {
        return Ok(());
    }
    let detail = format!(
        "no room for this upload: it needs {bytes} bytes and its job up to {job_bytes}; {room} are free, of which {promised} \
         are promised to uploads in progress and {reserve} must stay free; delete old stacks or enlarge the disk"
    );
    Err(ApiError::new(Code::InsufficientStorage, detail))
}

/// Too many jobs wait.
pub fn queue_full(waiting: u64) -> ApiError {
    ApiError::new(Code::QueueFull, format!("{waiting} jobs wait already; try again later"))
}

/// True when the client waits for `100 Continue` before it sends.
pub fn waits_for_continue(headers: &HeaderMap) -> bool {
    headers.get(header::EXPECT).is_some_and(|v| v.as_bytes().eq_ignore_ascii_case(b"100-continue"))
}

/// What the client says its body has, bytes.
pub fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}
