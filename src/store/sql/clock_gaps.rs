//! Jumps of the wall clock: the statements. See [`crate::store::rows::clock_gaps`].

use super::engine::Metadata;
use crate::store::{
    StoreResult,
    rows::{
        clock_gaps::warn,
        transaction::{Lock, Notice},
    },
};

/// That an upload has not expired, as a condition on a row of `uploads`: a gap of the clock does not count towards its
/// time. `$now`: the parameter with the time.
macro_rules! not_expired {
    ($now:literal) => {
        concat!(
            "expires_at + (SELECT CAST(COALESCE(SUM(gap_ms), 0) AS bigint) FROM clock_gaps WHERE at_ms > uploads.created_at) > ",
            $now
        )
    };
}
pub(super) use not_expired;

/// Observes the clock, and stores a gap if it jumped. To be called before anything expires.
pub(super) async fn observe(store: &Metadata) -> StoreResult<()> {
    let mut tx = store.write_alone(Lock::Expiry).await?;
    let (now, steady) = (store.now(&mut *tx).await?, store.clock.steady());
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
                     UNION ALL SELECT MAX(created_at) AS at FROM tokens) AS times",
            )
            .fetch_one(&mut *tx)
            .await?
        }
    };
    if let Some(gap) = store.last_seen.gap(newest, now, steady) {
        sqlx::query(
            "INSERT INTO clock_gaps (at_ms, gap_ms) VALUES ($1, $2)
             ON CONFLICT (at_ms) DO UPDATE SET gap_ms = $2",
        )
        .bind(now)
        .bind(gap)
        .execute(&mut *tx)
        .await?;
        warn(gap);
    }
    // a clock that is set back removes the gaps after its time
    sqlx::query("DELETE FROM clock_gaps WHERE at_ms > $1").bind(now).execute(&mut *tx).await?;
    sqlx::query("INSERT INTO clock_seen (id, at_ms) VALUES (1, $1) ON CONFLICT (id) DO UPDATE SET at_ms = $1")
        .bind(now)
        .execute(&mut *tx)
        .await?;
    store.commit(tx, "rows.see_clock", Notice::None).await?;
    store.last_seen.set(now, steady);
    Ok(())
}

/// Confirms the clock: removes all gaps.
pub(super) async fn confirm(store: &Metadata) -> StoreResult<()> {
    observe(store).await?;
    let mut tx = store.write_alone(Lock::Expiry).await?;
    sqlx::query("DELETE FROM clock_gaps").execute(&mut *tx).await?;
    store.commit(tx, "rows.see_clock", Notice::None).await
}
