//! Sums over all rows. Each query reads one covering index and no row, so a scrape stays cheap with many jobs.

use super::{
    SqliteMetadata, StoreResult, Totals,
    row::{kind, state, time, unsigned},
};
use crate::store::totals::{JobTotals, QuotaUse};

pub(super) async fn totals(store: &SqliteMetadata) -> StoreResult<Totals> {
    let now = store.clock.now_ms();
    let rows: Vec<(String, String, i64, i64, i64, i64)> = sqlx::query_as(
        "SELECT kind, state, count(*), SUM(upload_bytes), SUM(result_bytes), MIN(created_at)
         FROM jobs GROUP BY kind, state",
    )
    .fetch_all(&store.readers)
    .await?;
    let jobs = rows.into_iter().map(|(kind_name, state_name, count, uploads, results, oldest)| {
        Ok(JobTotals {
            kind: kind(&kind_name)?,
            state: state(&state_name)?,
            count: unsigned(count),
            upload_bytes: unsigned(uploads),
            result_bytes: unsigned(results),
            oldest: time(oldest)?,
        })
    });
    let jobs = jobs.collect::<StoreResult<Vec<_>>>()?;
    let (open, received): (i64, i64) = sqlx::query_as(
        "SELECT count(*), COALESCE(SUM(received), 0) FROM uploads
         WHERE job_kind IS NULL AND fault IS NULL AND expires_at > ?1",
    )
    .bind(now)
    .fetch_one(&store.readers)
    .await?;
    // the same sum as `Tokens::used_bytes`
    let quotas: Vec<(i64, i64)> = sqlx::query_as(
        "SELECT quota_bytes, COALESCE(SUM(bytes), 0)
         FROM tokens LEFT JOIN (
             SELECT owner, upload_bytes + result_bytes AS bytes FROM jobs WHERE owner IS NOT NULL
             UNION ALL
             SELECT owner, length FROM uploads
             WHERE owner IS NOT NULL AND job_kind IS NULL AND fault IS NULL AND expires_at > ?1
         ) ON owner = tokens.id
         WHERE quota_bytes IS NOT NULL AND revoked_at IS NULL GROUP BY tokens.id",
    )
    .bind(now)
    .fetch_all(&store.readers)
    .await?;
    let quotas = quotas.into_iter().map(|(quota, used)| QuotaUse { quota: unsigned(quota), used: unsigned(used) });
    Ok(Totals { jobs, open_uploads: unsigned(open), open_upload_bytes: unsigned(received), quotas: quotas.collect() })
}
