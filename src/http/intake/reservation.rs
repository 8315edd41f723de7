//! What an upload in progress holds: room on the disk, a little ahead of its bytes, and a part of its token's quota.
//!
//! Bytes are reserved as they come. An upload that announces much and sends nothing holds at most [`AHEAD`], and the
//! uploads of one token together hold at most `upload_reserve_bytes`; beyond that each reserves only the bytes that have
//! arrived. So announcements alone lock nobody out.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use uuid::Uuid;

use crate::{
    contract::Code,
    disk_budget::{DiskState, Reservation},
    http::{
        intake::quota::QuotaClaim,
        problem::{ApiError, ApiResult},
        state::App,
    },
};

/// Most bytes that one upload reserves ahead of those that have arrived.
const AHEAD: u64 = 1 << 30;
/// The same for an upload of unknown length.
const AHEAD_OF_UNKNOWN: u64 = 64 << 20;

/// The reservation of one upload in progress.
pub struct UploadReservation {
    app: App,
    /// Announced and not written yet; `None` when the length is unknown.
    rest: Option<u64>,
    received: u64,
    room: Reservation,
    share: Share,
    quota: QuotaClaim,
}

impl UploadReservation {
    /// Admits an upload of `announced` bytes that `owner` sends, if there is room for it and for the `job_bytes` of its
    /// job. Room for the job is looked for and not reserved: a job waits for its room.
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
            Ok(room) => Ok(Self { app: app.clone(), rest: announced, received: 0, room, share, quota }),
            Err(state) => Err(no_room(length, job_bytes, &state)),
        }
    }

    /// Reserves room for the next `bytes`; to be called before they are written.
    ///
    /// # Errors
    /// `insufficient_storage` with figures.
    pub async fn require(&mut self, bytes: u64) -> ApiResult<()> {
        self.quota.cover(self.received + bytes).await?;
        let Some(least) = bytes.checked_sub(self.room.bytes()).filter(|least| *least > 0) else { return Ok(()) };
        let wanted = self.rest.map_or(AHEAD_OF_UNKNOWN, |rest| rest.min(AHEAD)).saturating_sub(bytes);
        let ahead = self.share.take_at_most(wanted, self.app.policy.upload_reserve_bytes);
        let mut granted = self.app.disk.reserve(least + ahead).await?;
        if granted.is_err() && ahead > 0 {
            self.share.give(ahead);
            granted = self.app.disk.reserve(least).await?;
        }
        let room = granted.map_err(|state| no_room(self.rest.unwrap_or(bytes), 0, &state))?;
        self.share.take(least);
        self.room.absorb(room);
        Ok(())
    }

    /// `bytes` have been written.
    pub fn written(&mut self, bytes: u64) {
        let before = self.room.bytes();
        self.room.written(bytes);
        self.share.give(before - self.room.bytes());
        self.rest = self.rest.map(|rest| rest.saturating_sub(bytes));
        self.received += bytes;
    }

    /// All bytes are here: the room that is left goes back, the claim on the quota stays.
    pub fn into_quota(self) -> QuotaClaim {
        self.quota
    }
}

/// Checks that an upload of `bytes` and the `job_bytes` of its job would fit now; nothing is reserved.
///
/// # Errors
/// `insufficient_storage` with figures.
pub async fn require_room(app: &App, bytes: u64, job_bytes: u64) -> ApiResult<()> {
    let fits = app.disk.reserve_beside(0, bytes.saturating_add(job_bytes)).await?;
    fits.map(drop).map_err(|state| no_room(bytes, job_bytes, &state))
}

fn no_room(bytes: u64, job_bytes: u64, state: &DiskState) -> ApiError {
    let DiskState { free, reserved, min_free, .. } = state;
    let detail = format!(
        "no room for this upload: it needs {bytes} bytes and its job up to {job_bytes}; {free} are free, of which \
         {reserved} are reserved by uploads and jobs in progress and {min_free} must stay free; delete old stacks or \
         enlarge the disk"
    );
    ApiError::new(Code::InsufficientStorage, detail)
}

/// Bytes that the uploads in progress of each token have reserved and not written; those sent without a token together.
#[derive(Clone, Default)]
pub struct Shares(Arc<Mutex<HashMap<Option<Uuid>, u64>>>);

impl Shares {
    /// An empty share of a token.
    fn of(&self, owner: Option<Uuid>) -> Share {
        Share { shares: self.clone(), owner, bytes: 0 }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Option<Uuid>, u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What one upload has of the share of its token; given back when dropped.
struct Share {
    shares: Shares,
    owner: Option<Uuid>,
    bytes: u64,
}

impl Share {
    /// Takes as much of `wanted` as the token may have below `limit`: how much that is.
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
