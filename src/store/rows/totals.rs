//! Sums over all rows.

use super::{kind, state, time, unsigned};
use crate::store::{
    StoreResult, Totals,
    totals::{JobTotals, QuotaUse},
};

/// Kind, state, number of jobs, bytes of uploads, bytes of results, oldest acceptance.
pub(in crate::store) type JobTotalsRow = (String, String, i64, i64, i64, i64);

/// The sums. `open`: number of open uploads and their bytes. `quotas`: bytes of each quota and of its use.
pub(in crate::store) fn from_rows(
    rows: Vec<JobTotalsRow>,
    open: (i64, i64),
    quotas: Vec<(i64, i64)>,
) -> StoreResult<Totals> {
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
    let quotas = quotas.into_iter().map(|(quota, used)| QuotaUse { quota: unsigned(quota), used: unsigned(used) });
    let (open_uploads, open_upload_bytes) = (unsigned(open.0), unsigned(open.1));
    Ok(Totals { jobs, open_uploads, open_upload_bytes, quotas: quotas.collect() })
}
