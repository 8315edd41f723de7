//! Jumps of the wall clock. Expiry deletes for ever, so a clock that jumps must not expire anything.
//!
//! Each garbage collection stores the time at which it ran. If the wall clock then advances by more than a day that no
//! process observed, the difference is stored as a gap. Everything created before a gap is kept longer by its length.
//! Within one process the monotonic clock measures how much time passed, so collections may be far apart.

use std::{sync::Mutex, sync::PoisonError, time::Duration};

use super::{SqliteMetadata, StoreResult};

/// Largest unobserved step of the wall clock that counts as time that passed, ms.
const MAX_STEP_MS: i64 = 24 * 60 * 60 * 1000;

/// The last observation of this process: wall-clock time in ms and monotonic time.
#[derive(Debug, Default)]
pub(super) struct LastSeen(Mutex<Option<(i64, Duration)>>);

impl LastSeen {
    /// The wall-clock time that is expected now, unless the clock was set.
    fn expected(&self, steady: Duration) -> Option<i64> {
        let seen = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        seen.map(|(at_ms, then)| {
            let passed = steady.saturating_sub(then).as_millis();
            at_ms.saturating_add(i64::try_from(passed).unwrap_or(i64::MAX))
        })
    }

    fn set(&self, at_ms: i64, steady: Duration) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((at_ms, steady));
    }
}

/// Observes the clock, and stores a gap if it jumped. To be called before anything expires.
pub(super) async fn observe(store: &SqliteMetadata) -> StoreResult<()> {
    let (now, steady) = (store.clock.now_ms(), store.clock.steady());
    let mut tx = store.write().await?;
    let seen: Option<i64> = sqlx::query_scalar("SELECT at_ms FROM clock_seen").fetch_optional(&mut *tx).await?;
    let newest: Option<i64> = match seen {
        Some(_) => seen,
        // the first observation in this store: the newest row is the latest known time
        None => {
            sqlx::query_scalar(
                "SELECT MAX(at) FROM (
                     SELECT MAX(created_at) AS at FROM jobs
                     UNION ALL SELECT MAX(finished_at) AS at FROM jobs
                     UNION ALL SELECT MAX(created_at) AS at FROM uploads
                     UNION ALL SELECT MAX(created_at) AS at FROM tokens)",
            )
            .fetch_one(&mut *tx)
            .await?
        }
    };
    let last = newest.unwrap_or(now).max(store.last_seen.expected(steady).unwrap_or(i64::MIN));
    let gap = now.saturating_sub(last);
    if gap > MAX_STEP_MS {
        sqlx::query("INSERT OR REPLACE INTO clock_gaps (at_ms, gap_ms) VALUES (?1, ?2)")
            .bind(now)
            .bind(gap)
            .execute(&mut *tx)
            .await?;
        tracing::error!(
            days = gap / MAX_STEP_MS,
            "the clock is more than a day ahead of the last garbage collection: it was set, or no server ran. This time does \
             not count towards expiry: existing stacks and uploads are kept that much longer. If the clock is right, run \
             'pinstack gc --clock-is-right' to let them expire by it; if it is wrong, set it"
        );
    }
    // a clock that is set back removes the gaps after its time
    sqlx::query("DELETE FROM clock_gaps WHERE at_ms > ?1").bind(now).execute(&mut *tx).await?;
    sqlx::query("INSERT INTO clock_seen (id, at_ms) VALUES (1, ?1) ON CONFLICT (id) DO UPDATE SET at_ms = ?1")
        .bind(now)
        .execute(&mut *tx)
        .await?;
    store.commit(tx, "rows.see_clock").await?;
    store.last_seen.set(now, steady);
    Ok(())
}

/// Confirms the clock: removes all gaps.
pub(super) async fn confirm(store: &SqliteMetadata) -> StoreResult<()> {
    observe(store).await?;
    let mut tx = store.write().await?;
    sqlx::query("DELETE FROM clock_gaps").execute(&mut *tx).await?;
    store.commit(tx, "rows.see_clock").await
}
