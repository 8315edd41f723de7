//! What an upload in progress reserves: disk space a little ahead of its bytes, and a part of its token's quota.
//!
//! Space is reserved as bytes arrive. An upload that announces much and sends nothing reserves at most [`AHEAD`]. The
//! uploads of one token together reserve at most `upload_reserve_bytes` ahead; beyond that each reserves only what has
//! arrived. So announced lengths alone cannot exhaust the disk budget.

use std::sync::Arc;

use uuid::Uuid;

use super::quota::QuotaClaim;
use crate::{
    contract::Code,
    disk_budget::{DiskBudget, DiskState, Reservation, Reserved},
    http::{ApiError, ApiResult, App, state::token_sums::TokenSums},
};

/// Most bytes that one upload reserves ahead of those that have arrived.
const AHEAD: u64 = 1 << 30;
/// The same for an upload of unknown length.
const AHEAD_OF_UNKNOWN: u64 = 64 << 20;

/// The reservation of one upload in progress.
pub struct UploadReservation {
    disk: Arc<DiskBudget>,
    /// Bytes announced and not yet written; `None` when the length is unknown.
    rest: Option<u64>,
    received: u64,
    space: Reservation,
    share: Share,
    quota: QuotaClaim,
}

impl UploadReservation {
    /// Admits an upload of `announced` bytes from `owner`, if there is space for it and for the `job_bytes` of its job.
    /// Space for the job is checked and not reserved: a job waits until it can reserve its own.
    ///
    /// # Errors
    /// `insufficient_storage` with figures.
    pub async fn admit(
        app: &App,
        owner: Option<Uuid>,
        announced: Option<u64>,
        job_bytes: u64,
        mut quota: QuotaClaim,
    ) -> ApiResult<Self> {
        let length = announced.unwrap_or(0);
        quota.cover(length).await?;
        let limit = app.policy.upload_reserve_bytes;
        let mut share = Share { sums: app.reserved_ahead.clone(), owner, limit, bytes: 0 };
        let ahead = share.take_at_most(length.min(AHEAD), limit);
        let beside = (length - ahead).saturating_add(job_bytes);
        match app.disk.reserve_beside(ahead, beside).await? {
            Reserved::Granted(space) => {
                Ok(Self { disk: Arc::clone(&app.disk), rest: announced, received: 0, space, share, quota })
            }
            Reserved::Full(state) => Err(disk_full(length, job_bytes, &state)),
        }
    }

    /// Reserves space for the next `bytes`. Call it before they are written.
    ///
    /// # Errors
    /// `insufficient_storage` with figures.
    pub async fn require(&mut self, bytes: u64) -> ApiResult<()> {
        self.quota.cover(self.received + bytes).await?;
        let Some(least) = bytes.checked_sub(self.space.bytes()).filter(|least| *least > 0) else { return Ok(()) };
        let wanted = self.rest.map_or(AHEAD_OF_UNKNOWN, |rest| rest.min(AHEAD)).saturating_sub(bytes);
        let ahead = self.share.take_at_most(wanted, self.share.limit);
        let mut granted = self.disk.reserve(least + ahead).await?;
        if matches!(granted, Reserved::Full(_)) && ahead > 0 {
            self.share.give(ahead);
            granted = self.disk.reserve(least).await?;
        }
        let space = granted.granted().map_err(|state| disk_full(self.rest.unwrap_or(bytes), 0, &state))?;
        self.share.take(least);
        self.space.absorb(space);
        Ok(())
    }

    /// Records that `bytes` have been written.
    pub fn written(&mut self, bytes: u64) {
        let before = self.space.bytes();
        self.space.written(bytes);
        self.share.give(before - self.space.bytes());
        self.rest = self.rest.map(|rest| rest.saturating_sub(bytes));
        self.received += bytes;
    }

    /// Releases the unused space after the last byte; the claim on the quota stays.
    pub fn into_quota(self) -> QuotaClaim {
        self.quota
    }
}

/// The error for a disk budget that cannot cover an upload and its job.
pub fn disk_full(bytes: u64, job_bytes: u64, state: &DiskState) -> ApiError {
    let DiskState { free, reserved, min_free, .. } = state;
    let detail = format!(
        "not enough disk space for this upload: it needs {bytes} bytes and its job up to {job_bytes}; {free} bytes are \
         free, of which {reserved} are reserved by uploads and jobs in progress and {min_free} must stay free; delete \
         old stacks or enlarge the disk"
    );
    ApiError::new(Code::InsufficientStorage, detail)
}

/// What one upload adds to the bytes that the uploads of its token reserve ahead; released on drop. Uploads without a
/// token share one sum.
struct Share {
    sums: TokenSums,
    owner: Option<Uuid>,
    /// Most bytes that the uploads of one token may reserve ahead.
    limit: u64,
    bytes: u64,
}

impl Share {
    /// Takes up to `wanted` bytes, as far as the token stays within `limit`. Returns the bytes taken.
    fn take_at_most(&mut self, wanted: u64, limit: u64) -> u64 {
        let taken = self.sums.change(self.owner, |held| {
            let taken = wanted.min(limit.saturating_sub(*held));
            *held += taken;
            taken
        });
        self.bytes += taken;
        taken
    }

    fn take(&mut self, bytes: u64) {
        self.take_at_most(bytes, u64::MAX);
    }

    fn give(&mut self, bytes: u64) {
        self.bytes -= bytes;
        self.sums.change(self.owner, |held| *held -= bytes);
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.give(self.bytes);
    }
}
