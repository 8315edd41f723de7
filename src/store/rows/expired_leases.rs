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
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use uuid::Uuid;

use crate::{
    contract::Progress,
    store::{Attempt, StoreError, StoreResult, clock::later},
};

/// A lease that has expired by the wall clock must also have been unchanged for this fraction of its length: several
/// heartbeats.
const PATIENCE: u32 = 5;

/// A lease as stored. Each claim changes the token, each heartbeat the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::store) struct Lease {
    pub(in crate::store) token: i64,
    pub(in crate::store) until: i64,
    /// The length that its worker uses. Leases of this process may have another.
    pub(in crate::store) length: Duration,
}

/// Id of a running job, its lease token, the end of its lease, and the length in ms.
pub(in crate::store) type LeaseRow = (Uuid, i64, i64, i64);

impl Lease {
    /// The job and its lease.
    pub(in crate::store) fn of_row(&(id, token, until, ms): &LeaseRow) -> (Uuid, Self) {
        (id, Self { token, until, length: Duration::from_millis(ms.unsigned_abs()) })
    }
}

/// The leases that this process has observed, each with the monotonic time of its last change.
#[derive(Debug, Default)]
pub(in crate::store) struct LeaseObserver {
    seen: Mutex<HashMap<Uuid, (Lease, Duration)>>,
    was_interrupted: AtomicBool,
}

impl LeaseObserver {
    /// Observes all leases and returns those that have expired. `now_ms`: wall-clock time; `steady`: monotonic time.
    pub(in crate::store) fn expired(&self, leases: &[(Uuid, Lease)], now_ms: i64, steady: Duration) -> Vec<Uuid> {
        let mut seen = self.lock();
        let begins_anew = self.was_interrupted.swap(false, Ordering::Relaxed);
        let known = std::mem::take(&mut *seen);
        let mut expired = Vec::new();
        for (id, lease) in leases {
            let since = match known.get(id) {
                Some((before, since)) if before == lease && !begins_anew => *since,
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
    pub(in crate::store) fn granted(&self, id: Uuid, lease: Lease, steady: Duration) {
        self.lock().insert(id, (lease, steady));
    }

    /// Records whether a statement reached the database. While it does not, no worker can renew its lease, so that time
    /// is no silence of a worker: it is counted from the next look on.
    pub(in crate::store) fn reached<T>(&self, result: StoreResult<T>) -> StoreResult<T> {
        if matches!(result, Err(StoreError::Unavailable(_))) {
            self.was_interrupted.store(true, Ordering::Relaxed);
        }
        result
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Uuid, (Lease, Duration)>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Longest pause of a released job. A longer one is the result of a clock that was set back; it is treated as over.
pub(in crate::store) const MAX_PAUSE: Duration = Duration::from_secs(60 * 60);

/// What a release subtracts from the attempts, and the time before which the job is not claimed again.
pub(in crate::store) fn release_values(attempt: Attempt, now_ms: i64) -> (i64, Option<i64>) {
    match attempt {
        Attempt::Counted { pause } => (0, after(pause, now_ms)),
        Attempt::Postponed { pause } => (1, after(pause, now_ms)),
        Attempt::NotCounted => (1, None),
    }
}

fn after(pause: Duration, now_ms: i64) -> Option<i64> {
    (!pause.is_zero()).then(|| later(now_ms, pause.min(MAX_PAUSE)))
}

/// The fraction of a progress as a row has it: finite, 0 to 1.
pub(in crate::store) fn fraction(progress: &Progress) -> f64 {
    if progress.fraction.is_finite() { progress.fraction.clamp(0.0, 1.0) } else { 0.0 }
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
    fn the_time_in_which_the_database_was_away_is_no_silence() {
        let (observer, id) = (LeaseObserver::default(), Uuid::now_v7());
        let look = |at| observer.expired(&[(id, lease(1_000))], 60_000, after(at));
        assert!(look(100).is_empty());
        let away: StoreResult<()> = Err(StoreError::Unavailable(anyhow::anyhow!("it restarts")));
        assert!(observer.reached(away).is_err() && observer.reached(Ok(())).is_ok());
        assert!(look(130).is_empty(), "its worker could not renew it");
        assert!(look(132).is_empty());
        assert_eq!(look(133), [id], "and still has not");
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
