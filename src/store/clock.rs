//! Time: the clock of the system.

use std::{
    sync::LazyLock,
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
