//! Sums over all rows. Jobs are read from covering indices alone, so a scrape stays cheap with many of them. Open
//! uploads are few.

use super::{clock_gaps::not_expired, engine::Metadata};
use crate::store::{
    StoreResult, Totals,
    rows::totals::{JobTotalsRow, from_rows},
};

/// The sums that [`MetadataStore::totals`](crate::store::MetadataStore::totals) returns.
pub(in crate::store) async fn totals(store: &Metadata) -> StoreResult<Totals> {
    let now = store.now(store.reading()).await?;
    let rows: Vec<JobTotalsRow> = sqlx::query_as(
        "SELECT kind, state, count(*), CAST(SUM(upload_bytes) AS bigint), CAST(SUM(result_bytes) AS bigint), MIN(created_at)
         FROM jobs GROUP BY kind, state",
    )
    .fetch_all(store.reading())
    .await?;
    let (open, received): (i64, i64) = sqlx::query_as(concat!(
        "SELECT count(*), CAST(COALESCE(SUM(received), 0) AS bigint) FROM uploads
         WHERE job_kind IS NULL AND fault IS NULL AND ",
        not_expired!("$1")
    ))
    .bind(now)
    .fetch_one(store.reading())
    .await?;
    // the same sum as `Tokens::used_bytes`
    let quotas: Vec<(i64, i64)> = sqlx::query_as(concat!(
        "SELECT quota_bytes, CAST(COALESCE(SUM(bytes), 0) AS bigint)
         FROM tokens LEFT JOIN (
             SELECT owner, upload_bytes + result_bytes AS bytes FROM jobs WHERE owner IS NOT NULL
             UNION ALL
             SELECT owner, length FROM uploads
             WHERE owner IS NOT NULL AND job_kind IS NULL AND fault IS NULL AND ",
        not_expired!("$1"),
        "
         ) AS used ON used.owner = tokens.id
         WHERE quota_bytes IS NOT NULL AND revoked_at IS NULL GROUP BY tokens.id"
    ))
    .bind(now)
    .fetch_all(store.reading())
    .await?;
    from_rows(rows, (open, received), quotas)
}
