//! Time: the clock of the system, or the clock of a test.

use std::{
    sync::{
        LazyLock,
        atomic::{AtomicI64, Ordering},
    },
    time::{Duration, Instant},
};

use jiff::Timestamp;

/// The source of time for leases and expiry. Tests replace it to let time pass without waiting.
pub trait Clock: Send + Sync + 'static {
    /// Wall-clock time in milliseconds since 1970-01-01 UTC. It may be set, and so jump.
    fn now_ms(&self) -> i64;
    /// Monotonic time since an arbitrary moment. It never jumps; its value means nothing to another process.
    fn steady(&self) -> Duration;
}

/// A duration in whole milliseconds.
pub(crate) fn millis(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

/// The time `duration` after `now_ms`, in milliseconds.
pub(crate) fn later(now_ms: i64, duration: Duration) -> i64 {
    now_ms.saturating_add(millis(duration))
}

/// The clock of the system.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now_ms(&self) -> i64 {
        Timestamp::now().as_millisecond()
    }

    fn steady(&self) -> Duration {
        static START: LazyLock<Instant> = LazyLock::new(Instant::now);
        START.elapsed()
    }
}

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
