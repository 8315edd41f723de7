//! What an upload in progress reserves: disk space a little ahead of its bytes, and a part of its token's quota.
//!
//! Space is reserved as bytes arrive. An upload that announces much and sends nothing reserves at most [`AHEAD`]. The
//! uploads of one token together reserve at most `upload_reserve_bytes` ahead; beyond that each reserves only what has
//! arrived. So announced lengths alone cannot exhaust the disk budget.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use uuid::Uuid;

use super::{admission::disk_full, quota::QuotaClaim};
use crate::{
    disk_budget::{Reservation, Reserved},
    http::{problem::ApiResult, state::App},
};

/// Most bytes that one upload reserves ahead of those that have arrived.
const AHEAD: u64 = 1 << 30;
/// The same for an upload of unknown length.
const AHEAD_OF_UNKNOWN: u64 = 64 << 20;

/// The reservation of one upload in progress.
pub struct UploadReservation {
    app: App,
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
        let mut share = app.shares.of(owner);
        let ahead = share.take_at_most(length.min(AHEAD), app.policy.upload_reserve_bytes);
        let beside = (length - ahead).saturating_add(job_bytes);
        match app.disk.reserve_beside(ahead, beside).await? {
            Reserved::Granted(space) => {
                Ok(Self { app: app.clone(), rest: announced, received: 0, space, share, quota })
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
        let ahead = self.share.take_at_most(wanted, self.app.policy.upload_reserve_bytes);
        let mut granted = self.app.disk.reserve(least + ahead).await?;
        if matches!(granted, Reserved::Full(_)) && ahead > 0 {
            self.share.give(ahead);
            granted = self.app.disk.reserve(least).await?;
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

/// Bytes reserved and not yet written by the uploads of each token. Uploads without a token share one entry.
#[derive(Clone, Default)]
pub struct Shares(Arc<Mutex<HashMap<Option<Uuid>, u64>>>);

impl Shares {
    /// An empty share for a token.
    fn of(&self, owner: Option<Uuid>) -> Share {
        Share { shares: self.clone(), owner, bytes: 0 }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Option<Uuid>, u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What one upload takes of its token's share, released on drop.
struct Share {
    shares: Shares,
    owner: Option<Uuid>,
    bytes: u64,
}

impl Share {
    /// Takes up to `wanted` bytes, as far as the token stays within `limit`. Returns the bytes taken.
    fn take_at_most(&mut self, wanted: u64, limit: u64) -> u64 {
        let mut shares = self.shares.lock();
        let held = shares.entry(self.owner).or_default();
        let taken = wanted.min(limit.saturating_sub(*held));
        *held += taken;
        self.bytes += taken;
        taken
    }

    fn take(&mut self, bytes: u64) {
        self.take_at_most(bytes, u64::MAX);
    }

    fn give(&mut self, bytes: u64) {
        let mut shares = self.shares.lock();
        self.bytes -= bytes;
        if let Some(held) = shares.get_mut(&self.owner) {
            *held -= bytes;
            if *held == 0 {
                shares.remove(&self.owner);
            }
        }
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.give(self.bytes);
    }
}
