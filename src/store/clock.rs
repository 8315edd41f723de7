//! What time it is: the system's, or a test's.

use std::{
    sync::{
        LazyLock,
        atomic::{AtomicI64, Ordering},
    },
    time::{Duration, Instant},
};

use jiff::Timestamp;

/// What time it is. Leases and expiry are judged by it, so that tests can let time pass without waiting.
pub trait Clock: Send + Sync + 'static {
    /// Milliseconds since 1970-01-01 UTC: the wall's time, which somebody may set.
    fn now_ms(&self) -> i64;
    /// Time since some moment before: never leaps, and means nothing to another process.
    fn steady(&self) -> Duration;
}

/// The machine's clock.
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

/// A clock that stands still until it is told otherwise: for tests.
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
        let ms = i64::try_from(by.as_millis()).unwrap_or(i64::MAX);
        self.steady_ms.fetch_add(ms, Ordering::SeqCst);
        self.set_wall_by(ms);
    }

    /// Somebody sets the clock on the wall, by so many milliseconds.
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
