//! The disk budget: one ledger per process of the bytes that uploads, jobs and conversions may still write.
//!
//! In: the free bytes of the disk, and the bytes that must stay free (`min_free_bytes`). Out: reservations. The disk is
//! that of the blobs, which local blobs share with the workspace; where the blob store is unbounded, it is that of the
//! workspace. For every reservation that is granted, at the moment of its grant:
//!
//! ```text
//! sum of all reservations + min_free_bytes <= free bytes
//! ```
//!
//! A holder reports what it has written ([`Reservation::written`]): the free bytes already exclude these bytes, so they
//! must not be counted twice. Other processes on the same disk have budgets of their own; what they write counts once
//! it is written.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::store::{BlobStore, Store, StoreResult, Workspace, blobs::Capacity};

/// The budget of one process. Uploads, jobs and conversions share it.
pub struct DiskBudget {
    blobs: Arc<dyn BlobStore>,
    workspace: Arc<Workspace>,
    min_free_bytes: u64,
    ledger: Mutex<Ledger>,
}

/// Sums since the start of the process. Both only grow, so a sum that was read before the disk was measured is never
/// too large: no byte is missed that was written between the two.
#[derive(Debug, Default)]
struct Ledger {
    granted: u64,
    returned: u64,
}

/// The figures of the budget at one moment, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiskState {
    /// Bytes that can still be written.
    pub free: u64,
    /// Size of the disk.
    pub total: u64,
    /// Bytes reserved and not written yet.
    pub reserved: u64,
    /// Bytes that must stay free.
    pub min_free: u64,
}

impl DiskState {
    /// Bytes that can still be reserved.
    pub fn available(&self) -> u64 {
        self.free.saturating_sub(self.reserved).saturating_sub(self.min_free)
    }
}

impl DiskBudget {
    /// The budget of the disk that `store` is on, of which `min_free_bytes` must stay free.
    pub fn new(store: &Store, min_free_bytes: u64) -> Arc<Self> {
        let (blobs, workspace) = (Arc::clone(&store.blobs), Arc::clone(&store.workspace));
        Arc::new(Self { blobs, workspace, min_free_bytes, ledger: Mutex::default() })
    }

    async fn measure(&self) -> StoreResult<Capacity> {
        match self.blobs.capacity().await? {
            Some(capacity) => Ok(capacity),
            None => self.workspace.capacity().await,
        }
    }

    /// The figures now.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn state(&self) -> StoreResult<DiskState> {
        let returned = self.ledger().returned;
        let disk = self.measure().await?;
        let reserved = self.ledger().granted.wrapping_sub(returned);
        Ok(DiskState { free: disk.free, total: disk.total, reserved, min_free: self.min_free_bytes })
    }

    /// Reserves `bytes`.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn reserve(self: &Arc<Self>, bytes: u64) -> StoreResult<Reserved> {
        self.reserve_beside(bytes, 0).await
    }

    /// Reserves space for a stored file of `bytes` that is about to be read as a whole: a file in a bucket is copied to
    /// this machine first. To be held until it is copied. A file that is here needs nothing.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn reserve_copy(self: &Arc<Self>, bytes: u64) -> StoreResult<Reserved> {
        self.reserve(if self.blobs.is_local() { 0 } else { bytes }).await
    }

    /// Reserves `bytes` if `beside` more would fit as well: bytes that will be needed and are reserved later.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn reserve_beside(self: &Arc<Self>, bytes: u64, beside: u64) -> StoreResult<Reserved> {
        // before the disk is measured: see `Ledger`
        let returned = self.ledger().returned;
        let disk = self.measure().await?;
        let mut ledger = self.ledger();
        let reserved = ledger.granted.wrapping_sub(returned);
        let state = DiskState { free: disk.free, total: disk.total, reserved, min_free: self.min_free_bytes };
        if bytes.checked_add(beside).is_none_or(|needed| needed > state.available()) {
            return Ok(Reserved::Full(state));
        }
        ledger.granted = ledger.granted.wrapping_add(bytes);
        Ok(Reserved::Granted(Reservation { budget: Arc::clone(self), bytes }))
    }

    /// Bytes reserved and not written yet.
    pub fn reserved(&self) -> u64 {
        let ledger = self.ledger();
        ledger.granted.wrapping_sub(ledger.returned)
    }

    fn ledger(&self) -> MutexGuard<'_, Ledger> {
        self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What came of a request for disk space.
#[derive(Debug)]
#[must_use = "it may not fit, and a reservation that is dropped is returned"]
pub enum Reserved {
    /// It fits.
    Granted(Reservation),
    /// It does not fit: the figures.
    Full(DiskState),
}

impl Reserved {
    /// The reservation, or the figures as an error.
    ///
    /// # Errors
    /// When it does not fit.
    pub fn granted(self) -> Result<Reservation, DiskState> {
        match self {
            Self::Granted(reservation) => Ok(reservation),
            Self::Full(state) => Err(state),
        }
    }
}

/// Bytes of the disk that the holder may write. The bytes that were not written are returned when this is dropped.
pub struct Reservation {
    budget: Arc<DiskBudget>,
    bytes: u64,
}

impl std::fmt::Debug for Reservation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reservation").field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl Reservation {
    /// Bytes that may still be written.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reports that `bytes` have been written: the disk counts them from now on. Capped at the size of the reservation.
    pub fn written(&mut self, bytes: u64) {
        let bytes = bytes.min(self.bytes);
        self.bytes -= bytes;
        let mut ledger = self.budget.ledger();
        ledger.returned = ledger.returned.wrapping_add(bytes);
    }

    /// Merges another reservation of the same budget into this one.
    pub fn absorb(&mut self, mut other: Self) {
        debug_assert!(Arc::ptr_eq(&self.budget, &other.budget), "reservations of two budgets");
        self.bytes += std::mem::take(&mut other.bytes);
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.written(self.bytes);
    }
}

#[cfg(test)]
mod tests;
