//! Which leases have expired.
//!
//! The wall clock alone cannot decide that. If it jumps forward (a machine that gets the time after its start), every
//! worker seems dead; if it jumps back, a dead worker seems alive. So each process observes how long a lease has not
//! changed, by its monotonic clock. Let `L` be the length of the lease and `s` the time since its last change was
//! observed:
//!
//! ```text
//! expired  <=>  s >= L   or   (lease_until <= wall clock  and  s >= L / PATIENCE)
//! ```

use std::{
    collections::HashMap,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use uuid::Uuid;

/// A lease that has expired by the wall clock must also have been unchanged for this fraction of its length: several
/// heartbeats.
const PATIENCE: u32 = 5;

/// A lease as stored. Each claim changes the token, each heartbeat the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lease {
    pub(super) token: i64,
    pub(super) until: i64,
    /// The length that its worker uses. Leases of this process may have another.
    pub(super) length: Duration,
}

/// The leases that this process has observed, each with the monotonic time of its last change.
#[derive(Debug, Default)]
pub(super) struct LeaseObserver(Mutex<HashMap<Uuid, (Lease, Duration)>>);

impl LeaseObserver {
    /// Observes all leases and returns those that have expired. `now_ms`: wall-clock time; `steady`: monotonic time.
    pub(super) fn expired(&self, leases: &[(Uuid, Lease)], now_ms: i64, steady: Duration) -> Vec<Uuid> {
        let mut seen = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = std::mem::take(&mut *seen);
        let mut expired = Vec::new();
        for (id, lease) in leases {
            let since = match known.get(id) {
                Some((before, since)) if before == lease => *since,
                _ => steady,
            };
            let silent = steady.saturating_sub(since);
            if silent >= lease.length || (lease.until <= now_ms && silent >= lease.length / PATIENCE) {
                expired.push(*id);
            }
            seen.insert(*id, (*lease, since));
        }
        expired
    }

    /// Records a lease that this process granted.
    pub(super) fn granted(&self, id: Uuid, lease: Lease, steady: Duration) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(id, (lease, steady));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: Duration = Duration::from_secs(15);

    fn after(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    fn lease(until: i64) -> Lease {
        Lease { token: 1, until, length: LENGTH }
    }

    #[test]
    fn a_lease_that_expired_by_the_wall_clock_is_taken_after_some_silence() {
        let (observer, id) = (LeaseObserver::default(), Uuid::now_v7());
        let look = |at| observer.expired(&[(id, lease(1_000))], 2_000, after(at));
        assert!(look(100).is_empty(), "observed for the first time");
        assert!(look(102).is_empty());
        assert_eq!(look(103), [id]);
    }

    #[test]
    fn a_heartbeat_after_the_wall_clock_jumped_forward_keeps_the_lease() {
        let (observer, id) = (LeaseObserver::default(), Uuid::now_v7());
        observer.granted(id, lease(16_000), after(0));
        let jumped = 3_600_000;
        assert!(observer.expired(&[(id, lease(16_000))], jumped, after(1)).is_empty());
        assert!(observer.expired(&[(id, lease(jumped + 16_000))], jumped + 1_000, after(2)).is_empty());
    }

    #[test]
    fn the_lease_of_a_dead_worker_expires_although_the_wall_clock_jumped_back() {
        let (observer, id) = (LeaseObserver::default(), Uuid::now_v7());
        let look = |at| observer.expired(&[(id, lease(3_600_000))], 5, after(at));
        assert!(look(0).is_empty());
        assert!(look(14).is_empty());
        assert_eq!(look(15), [id]);
    }

    #[test]
    fn a_new_claim_is_a_new_lease_and_a_lease_that_ended_is_forgotten() {
        let (observer, id) = (LeaseObserver::default(), Uuid::now_v7());
        let look = |token, at| observer.expired(&[(id, Lease { token, until: 0, length: LENGTH })], 1, after(at));
        look(1, 0);
        assert!(look(2, 20).is_empty());
        observer.expired(&[], 1, after(30));
        assert!(look(2, 60).is_empty());
    }
}
