//! Whose bucket it is. Garbage collection removes what no row refers to, so two databases must never share a bucket:
//! the first one that opens it writes its id into it, and every other one is refused.

use anyhow::anyhow;
use uuid::Uuid;

use super::bucket::Bucket;
use crate::store::{StoreError, StoreResult};

/// Key of the object with the id.
pub(super) const MARK: &str = "pinstack.store";
/// Longest content of it that is read.
const LONGEST: u64 = 64;

/// Takes a bucket that belongs to no database, and requires that any other belongs to `store`.
///
/// # Errors
/// When it belongs to another database, or does not answer.
pub(super) async fn claim(bucket: &Bucket, store: Uuid) -> StoreResult<()> {
    if bucket.create(MARK, store.to_string().into()).await? {
        return Ok(());
    }
    let found = bucket.get(MARK, 0..LONGEST).await?.unwrap_or_default();
    if std::str::from_utf8(&found).ok().and_then(|id| Uuid::try_parse(id.trim()).ok()) == Some(store) {
        return Ok(());
    }
    Err(StoreError::Other(anyhow!(
        "storage_url: the bucket, or this prefix of it, belongs to another database, whose files would be removed as \
         garbage; use another prefix (s3://bucket/another). If that database does not exist any more and its files are \
         to be taken over, remove the object {MARK} first"
    )))
}
