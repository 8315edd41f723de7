//! Jumps of the wall clock. Expiry deletes for ever, so a clock that jumps must not expire anything.
//!
//! Each garbage collection stores the time at which it ran. If the wall clock then advances by more than a day that no
//! process observed, the difference is stored as a gap. Everything created before a gap is kept longer by its length.
//! Within one process the monotonic clock measures how much time passed, so collections may be far apart.

use std::{
    sync::{Mutex, PoisonError},
    time::Duration,
};

/// Largest unobserved step of the wall clock that counts as time that passed, ms.
const MAX_STEP_MS: i64 = 24 * 60 * 60 * 1000;

/// The last observation of this process: wall-clock time in ms and monotonic time.
#[derive(Debug, Default)]
pub(in crate::store) struct LastSeen(Mutex<Option<(i64, Duration)>>);

impl LastSeen {
    /// The wall-clock time that is expected now, unless the clock was set.
    fn expected(&self, steady: Duration) -> Option<i64> {
        let seen = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        seen.map(|(at_ms, then)| {
            let passed = steady.saturating_sub(then).as_millis();
            at_ms.saturating_add(i64::try_from(passed).unwrap_or(i64::MAX))
        })
    }

    /// The step of the wall clock, ms, since the later of `stored` and the last observation; `None` when it is small
    /// enough to be time that passed. `stored`: the latest time that the store knows.
    pub(in crate::store) fn gap(&self, stored: Option<i64>, now_ms: i64, steady: Duration) -> Option<i64> {
        let last = stored.unwrap_or(now_ms).max(self.expected(steady).unwrap_or(i64::MIN));
        Some(now_ms.saturating_sub(last)).filter(|gap| *gap > MAX_STEP_MS)
    }

    pub(in crate::store) fn set(&self, at_ms: i64, steady: Duration) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((at_ms, steady));
    }
}

/// Reports a gap.
pub(in crate::store) fn warn(gap: i64) {
    tracing::error!(
        days = gap / MAX_STEP_MS,
        "the clock is more than a day ahead of the last garbage collection: it was set, or no server ran. This time does \
         not count towards expiry: existing stacks and uploads are kept that much longer. If the clock is right, run \
         'pinstack gc --clock-is-right' to let them expire by it; if it is wrong, set it"
    );
}
