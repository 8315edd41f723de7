//! Admission: what is checked before the body of an upload is read. Its length, the disk budget, the quota of the
//! token, and the length of the queue.

use super::{
    body::{content_length, too_large},
    quota::QuotaClaim,
    request::IngestRequest,
    reservation::{UploadReservation, disk_full},
};
use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App, auth::Caller},
};

/// Most bytes of a form besides the zip.
pub const FORM_OVERHEAD: u64 = 1 << 20;

/// Admits an upload whose body is at most `max_body` bytes, and reserves disk space for it. `job_bytes` is what its job
/// may write. A repeat of an earlier request makes no new job: neither quota nor queue count for it.
///
/// # Errors
/// `upload_too_large`; `insufficient_storage` with figures; `queue_full`.
pub async fn admit(request: &IngestRequest<'_>, max_body: u64, job_bytes: u64) -> ApiResult<UploadReservation> {
    let IngestRequest { app, caller, headers, key } = request;
    let length = content_length(headers);
    if length.is_some_and(|length| length > max_body) {
        return Err(too_large(max_body).into());
    }
    let quota = match key.is_repeat {
        true => QuotaClaim::default(),
        false => QuotaClaim::of(app, caller, key.stored.clone()),
    };
    let reservation = UploadReservation::admit(app, caller.id(), length, job_bytes, quota).await?;
    if !key.is_repeat {
        require_queue_place(app).await?;
    }
    Ok(reservation)
}

/// Checks that an upload of `bytes` and its job, which may write `job_bytes`, would be admitted now. Nothing is
/// reserved: the bytes come in later requests, or are stored already.
///
/// # Errors
/// `insufficient_storage` with figures; `queue_full`.
pub async fn require_admissible(app: &App, caller: &Caller, bytes: u64, job_bytes: u64) -> ApiResult<()> {
    if bytes > 0 {
        QuotaClaim::of(app, caller, None).cover(bytes).await?;
    }
    let fits = app.disk.reserve_beside(0, bytes.saturating_add(job_bytes)).await?;
    fits.granted().map_err(|state| disk_full(bytes, job_bytes, &state))?;
    require_queue_place(app).await
}

async fn require_queue_place(app: &App) -> ApiResult<()> {
    let waiting = app.store.metadata.counts().await?.queued;
    if waiting >= app.policy.queue_limit { Err(queue_full(waiting)) } else { Ok(()) }
}

/// The error for a queue that has no place left.
pub fn queue_full(waiting: u64) -> ApiError {
    ApiError::new(Code::QueueFull, format!("the queue is full: {waiting} jobs are waiting; try again later"))
}
