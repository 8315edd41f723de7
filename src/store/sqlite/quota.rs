//! Quotas of tokens, checked in the transaction that takes the bytes: what was read still holds when it is written.

use sqlx::SqliteConnection;
use uuid::Uuid;

use super::{
    StoreResult, retention,
    uploads::{signed, unsigned},
};
use crate::store::OverQuota;

/// Why `bytes` more do not fit into the quota of `owner`; `None` when they do, or there is no quota.
pub(super) async fn exceeded(
    connection: &mut SqliteConnection,
    owner: Option<Uuid>,
    bytes: u64,
    now: i64,
) -> StoreResult<Option<OverQuota>> {
    let Some(owner) = owner else { return Ok(None) };
    let token: Option<(String, Option<i64>)> = sqlx::query_as("SELECT name, quota_bytes FROM tokens WHERE id = ?1")
        .bind(owner)
        .fetch_optional(&mut *connection)
        .await?;
    let Some((token, Some(quota))) = token else { return Ok(None) };
    let used = retention::bytes_taken(connection, owner, now).await?;
    let fits = used.checked_add(signed(bytes)).is_some_and(|all| all <= quota);
    Ok((!fits).then(|| OverQuota { token, used: unsigned(used), quota: unsigned(quota) }))
}
