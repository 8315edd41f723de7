//! Which leases are over. The clock on the wall alone does not say: when it leaps forward (a machine that learns the time
//! after its start), every worker would look dead, and when it leaps back, a dead one would look alive for as long.
//! So a process watches the leases of the others: one is over when nothing was heard of it for its whole length by a clock that never
//! leaps, or when it is over by the wall and nothing was heard of it for a while.

use std::{
    collections::HashMap,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use uuid::Uuid;

/// A lease that is over by the wall is taken once nothing was heard of its worker for this part of a lease: some beats.
const PATIENCE: u32 = 5;

/// A lease as its row has it. Each claim changes the token, each beat the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lease {
    pub(super) token: i64,
    pub(super) until: i64,
    /// How long it was given for: what its worker goes by, however long leases are where somebody looks.
    pub(super) length: Duration,
}

/// The leases that this process has seen, and since when they have not changed, by the clock that never leaps.
#[derive(Debug, Default)]
pub(super) struct Watched(Mutex<HashMap<Uuid, (Lease, Duration)>>);

impl Watched {
    /// Looks at all leases there are: those that are over. `now_ms` is the wall's time, `steady` that of the other clock.
    pub(super) fn lost(&self, leases: &[(Uuid, Lease)], now_ms: i64, steady: Duration) -> Vec<Uuid> {
        let mut seen = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = std::mem::take(&mut *seen);
        let mut lost = Vec::new();
        for (id, lease) in leases {
            let since = match known.get(id) {
                Some((before, since)) if before == lease => *since,
                _ => steady,
            };
            let silent = steady.saturating_sub(since);
            if silent >= lease.length || (lease.until <= now_ms && silent >= lease.length / PATIENCE) {
                lost.push(*id);
            }
            seen.insert(*id, (*lease, since));
        }
        lost
    }

    /// A lease that this process gave out itself.
    pub(super) fn given(&self, id: Uuid, lease: Lease, steady: Duration) {
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
    fn a_lease_that_is_over_by_the_wall_is_taken_after_a_while_of_silence() {
        let (watched, id) = (Watched::default(), Uuid::now_v7());
        let look = |at| watched.lost(&[(id, lease(1_000))], 2_000, after(at));
        assert!(look(100).is_empty(), "seen for the first time");
        assert!(look(102).is_empty());
        assert_eq!(look(103), [id]);
    }

    #[test]
    fn a_beat_after_the_wall_leapt_forward_keeps_the_lease() {
        let (watched, id) = (Watched::default(), Uuid::now_v7());
        watched.given(id, lease(16_000), after(0));
        let leapt = 3_600_000;
        assert!(watched.lost(&[(id, lease(16_000))], leapt, after(1)).is_empty());
        assert!(watched.lost(&[(id, lease(leapt + 16_000))], leapt + 1_000, after(2)).is_empty());
    }

    #[test]
    fn a_dead_workers_lease_ends_though_the_wall_leapt_back() {
        let (watched, id) = (Watched::default(), Uuid::now_v7());
        let look = |at| watched.lost(&[(id, lease(3_600_000))], 5, after(at));
        assert!(look(0).is_empty());
        assert!(look(14).is_empty());
        assert_eq!(look(15), [id]);
    }

    #[test]
    fn a_job_that_was_claimed_again_is_a_new_lease_and_one_that_is_gone_is_forgotten() {
        let (watched, id) = (Watched::default(), Uuid::now_v7());
        let look = |token, at| watched.lost(&[(id, Lease { token, until: 0, length: LENGTH })], 1, after(at));
        look(1, 0);
        assert!(look(2, 20).is_empty());
        watched.lost(&[], 1, after(30));
        assert!(look(2, 60).is_empty());
    }
}
