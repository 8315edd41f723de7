//! Quotas of tokens. A quota is checked within the transaction that adds the bytes, so concurrent requests cannot
//! exceed it together.

use sqlx::Executor;
use uuid::Uuid;

use super::{
    clock_gaps::not_expired,
    engine::{Connection, Db},
};
use crate::store::{
    OverQuota, StoreResult,
    rows::{signed, unsigned},
};

/// `None` when `bytes` more fit into the quota of `owner`, or when there is no quota.
pub(super) async fn exceeded(
    connection: &mut Connection,
    owner: Option<Uuid>,
    bytes: u64,
    now: i64,
) -> StoreResult<Option<OverQuota>> {
    let Some(owner) = owner else { return Ok(None) };
    let token: Option<(String, Option<i64>)> = sqlx::query_as("SELECT name, quota_bytes FROM tokens WHERE id = $1")
        .bind(owner)
        .fetch_optional(&mut *connection)
        .await?;
    let Some((token, Some(quota))) = token else { return Ok(None) };
    let used = used_bytes(connection, owner, now).await?;
    let fits = used.checked_add(signed(bytes)).is_some_and(|all| all <= quota);
    Ok((!fits).then(|| OverQuota { token, used: unsigned(used), quota: unsigned(quota) }))
}

/// Bytes that the stacks, calibrations and open uploads of a token use.
pub(super) async fn used_bytes(executor: impl Executor<'_, Database = Db>, owner: Uuid, now: i64) -> StoreResult<i64> {
    let bytes = sqlx::query_scalar(concat!(
        "SELECT (SELECT CAST(COALESCE(SUM(upload_bytes + result_bytes), 0) AS bigint) FROM jobs WHERE owner = $1)
              + (SELECT CAST(COALESCE(SUM(length), 0) AS bigint) FROM uploads
                 WHERE owner = $1 AND job_kind IS NULL AND fault IS NULL AND ",
        not_expired!("$2"),
        ")"
    ))
    .bind(owner)
    .bind(now)
    .fetch_one(executor)
    .await?;
    Ok(bytes)
}
