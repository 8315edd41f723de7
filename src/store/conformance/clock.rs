//! The clock of a test.

use std::{
    sync::atomic::{AtomicI64, Ordering},
    time::Duration,
};

use crate::store::{Clock, clock::millis};

/// A clock that only moves when a test advances it.
#[derive(Debug)]
pub struct ManualClock {
    wall_ms: AtomicI64,
    steady_ms: AtomicI64,
}

impl Default for ManualClock {
    /// Starts on 2026-01-01.
    fn default() -> Self {
        Self { wall_ms: AtomicI64::new(1_767_225_600_000), steady_ms: AtomicI64::new(0) }
    }
}

impl ManualClock {
    /// Lets time pass.
    pub fn advance(&self, by: Duration) {
        let ms = millis(by);
        self.steady_ms.fetch_add(ms, Ordering::SeqCst);
        self.set_wall_by(ms);
    }

    /// Sets the wall clock forward (or back) by `ms` milliseconds.
    pub fn set_wall_by(&self, ms: i64) {
        self.wall_ms.fetch_add(ms, Ordering::SeqCst);
    }
}

impl Clock for ManualClock {
    fn now_ms(&self) -> i64 {
        self.wall_ms.load(Ordering::SeqCst)
    }

    fn steady(&self) -> Duration {
        Duration::from_millis(self.steady_ms.load(Ordering::SeqCst).unsigned_abs())
    }
}
