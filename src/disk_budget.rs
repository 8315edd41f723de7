//! The disk budget: one ledger per process of the bytes that uploads, jobs and conversions may still write.
//!
//! In: the free bytes of the disk, as the blob store measures them, and the bytes that must stay free
//! (`min_free_bytes`). Out: reservations. For every reservation that is granted, at the moment of its grant:
//!
//! ```text
//! sum of all reservations + min_free_bytes <= free bytes
//! ```
//!
//! A holder tells its reservation what it has written ([`Reservation::written`]): these bytes are missing from the free
//! bytes already and must not be counted twice. Other processes on the same disk have budgets of their own; what they
//! write is seen as soon as it is written.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::store::{StoreResult, blobs::Blobs};

/// The budget of one process. Uploads, jobs and conversions share it.
pub struct DiskBudget {
    blobs: Arc<dyn Blobs>,
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
    /// Can still be written.
    pub free: u64,
    /// The size of the disk.
    pub total: u64,
    /// Reserved and not written yet.
    pub reserved: u64,
    /// Must stay free.
    pub min_free: u64,
}

impl DiskState {
    /// Bytes that can still be reserved.
    pub fn available(&self) -> u64 {
        self.free.saturating_sub(self.reserved).saturating_sub(self.min_free)
    }
}

impl DiskBudget {
    /// The budget of the disk that `blobs` lie on, of which `min_free_bytes` must stay free.
    pub fn new(blobs: Arc<dyn Blobs>, min_free_bytes: u64) -> Arc<Self> {
        Arc::new(Self { blobs, min_free_bytes, ledger: Mutex::default() })
    }

    /// The figures now.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn state(&self) -> StoreResult<DiskState> {
        let returned = self.ledger().returned;
        let room = self.blobs.room().await?;
        let reserved = self.ledger().granted.wrapping_sub(returned);
        Ok(DiskState { free: room.free, total: room.total, reserved, min_free: self.min_free_bytes })
    }

    /// Reserves `bytes`, or says with which figures they do not fit.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn reserve(self: &Arc<Self>, bytes: u64) -> StoreResult<Result<Reservation, DiskState>> {
        self.reserve_beside(bytes, 0).await
    }

    /// Reserves `bytes` if `beside` more would fit too: bytes that will be needed, and are reserved later.
    ///
    /// # Errors
    /// When the disk cannot be measured.
    pub async fn reserve_beside(
        self: &Arc<Self>,
        bytes: u64,
        beside: u64,
    ) -> StoreResult<Result<Reservation, DiskState>> {
        // before the disk is measured: see `Ledger`
        let returned = self.ledger().returned;
        let room = self.blobs.room().await?;
        let mut ledger = self.ledger();
        let reserved = ledger.granted.wrapping_sub(returned);
        let state = DiskState { free: room.free, total: room.total, reserved, min_free: self.min_free_bytes };
        if bytes.checked_add(beside).is_none_or(|needed| needed > state.available()) {
            return Ok(Err(state));
        }
        ledger.granted = ledger.granted.wrapping_add(bytes);
        Ok(Ok(Reservation { budget: Arc::clone(self), bytes }))
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

/// Bytes of the disk that its holder may write. What was not written goes back when this is dropped.
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

    /// `bytes` of it have been written: the disk counts them from now on. More than the reservation has is all of it.
    pub fn written(&mut self, bytes: u64) {
        let bytes = bytes.min(self.bytes);
        self.bytes -= bytes;
        let mut ledger = self.budget.ledger();
        ledger.returned = ledger.returned.wrapping_add(bytes);
    }

    /// Adds another reservation of the same budget to this one.
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
