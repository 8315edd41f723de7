//! What is known before the body is read: its length, the room on the disk, the length of the queue.

use axum::http::{HeaderMap, header};

use super::{body::too_large, quota::QuotaClaim, reservation::UploadReservation};
use crate::{
    contract::Code,
    http::{
        auth::Caller,
        problem::{ApiError, ApiResult},
        state::App,
    },
};

/// What a form may have around the zip itself.
pub const FORM_OVERHEAD: u64 = 1 << 20;

/// Admits an upload, or says why not. `job_bytes` is what its job may write.
///
/// # Errors
/// `upload_too_large`, `insufficient_storage` with figures, `queue_full`.
pub async fn admit(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    max_bytes: u64,
    is_repeat: bool,
    job_bytes: u64,
    quota: QuotaClaim,
) -> ApiResult<UploadReservation> {
    let length = content_length(headers);
    if length.is_some_and(|length| length > max_bytes) {
        return Err(too_large(app.policy.max_upload_bytes).into());
    }
    let reservation = UploadReservation::admit(app, caller.id(), length, job_bytes, quota).await?;
    // a repeat makes no new job
    if !is_repeat {
        require_place(app).await?;
    }
    Ok(reservation)
}

/// Checks that another job may wait.
///
/// # Errors
/// `queue_full`.
pub async fn require_place(app: &App) -> ApiResult<()> {
    let waiting = app.rows.counts().await?.queued;
    if waiting >= app.policy.queue_limit { Err(queue_full(waiting)) } else { Ok(()) }
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
