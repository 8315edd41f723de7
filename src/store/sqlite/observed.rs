//! Time that passed while somebody looked. Expiry deletes for ever, so a clock that leaps must expire nothing: each
//! clean-up keeps the time that it saw, and a step of more than a day that no process saw pass is kept as a gap.
//! A stack or an upload from before a gap stays longer by the length of the gap. Within one process the steady clock says how
//! much time passed, so clean-ups may be far apart.

use std::{sync::Mutex, sync::PoisonError, time::Duration};

use super::{SqliteRows, StoreResult};

/// A step of the clock up to this is believed, ms.
const BELIEVED_MS: i64 = 24 * 60 * 60 * 1000;

/// What this process saw last: time by the machine's clock in ms, and by the steady clock.
#[derive(Debug, Default)]
pub(super) struct Seen(Mutex<Option<(i64, Duration)>>);

impl Seen {
    /// What the clock must say by now, if nobody set it.
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

/// Looks at the clock, and keeps the gap if it leapt. Before anything expires.
pub(super) async fn observe(store: &SqliteRows) -> StoreResult<()> {
    let (now, steady) = (store.clock.now_ms(), store.clock.steady());
    let mut tx = store.write().await?;
    let seen: Option<i64> = sqlx::query_scalar("SELECT at_ms FROM clock_seen").fetch_optional(&mut *tx).await?;
    let newest: Option<i64> = match seen {
        Some(_) => seen,
        // the first clean-up of a store: nothing happened after its newest row
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
    let last = newest.unwrap_or(now).max(store.seen.expected(steady).unwrap_or(i64::MIN));
    let gap = now.saturating_sub(last);
    if gap > BELIEVED_MS {
        sqlx::query("INSERT OR REPLACE INTO clock_gaps (at_ms, gap_ms) VALUES (?1, ?2)")
            .bind(now)
            .bind(gap)
            .execute(&mut *tx)
            .await?;
        tracing::error!(
            days = gap / BELIEVED_MS,
            "the clock is more than a day ahead of the last clean-up: it was set, or no server ran. This time does not \
             count towards expiry: stacks and uploads of before stay that much longer. If the clock is right and they \
             shall go by it, run 'pinstack gc --clock-is-right'; if it is wrong, set it"
        );
    }
    // a clock that was set back to where it was takes its gap with it
    sqlx::query("DELETE FROM clock_gaps WHERE at_ms > ?1").bind(now).execute(&mut *tx).await?;
    sqlx::query("INSERT INTO clock_seen (id, at_ms) VALUES (1, ?1) ON CONFLICT (id) DO UPDATE SET at_ms = ?1")
        .bind(now)
        .execute(&mut *tx)
        .await?;
    store.commit(tx, "rows.see_clock").await?;
    store.seen.set(now, steady);
    Ok(())
}

/// The clock is right, however it got there: no gap counts any more.
pub(super) async fn trust(store: &SqliteRows) -> StoreResult<()> {
    observe(store).await?;
    let mut tx = store.write().await?;
    sqlx::query("DELETE FROM clock_gaps").execute(&mut *tx).await?;
    store.commit(tx, "rows.see_clock").await
}
