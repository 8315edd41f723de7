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
/// The mark is read before it is written, because a server that knows no conditional writes would replace it, and read
/// again after. On such a server, two databases that open an empty bucket in the same moment can still both take it.
///
/// # Errors
/// When it belongs to another database, or does not answer.
pub(super) async fn claim(bucket: &Bucket, store: Uuid) -> StoreResult<()> {
    if owner(bucket).await? == Owner::None {
        bucket.create(MARK, store.to_string().into()).await?;
    }
    if owner(bucket).await? == Owner::Database(store) {
        return Ok(());
    }
    Err(StoreError::Other(anyhow!(
        "storage_url: the bucket, or this prefix of it, belongs to another database, whose files would be removed as \
         garbage; use another prefix (s3://bucket/another). If that database does not exist any more and its files are \
         to be taken over, remove the object {MARK} first"
    )))
}

/// Whose bucket it is.
#[derive(Debug, PartialEq, Eq)]
enum Owner {
    None,
    Database(Uuid),
    /// The mark says something else.
    Unknown,
}

async fn owner(bucket: &Bucket) -> StoreResult<Owner> {
    let Some(mark) = bucket.get(MARK, 0..LONGEST).await? else { return Ok(Owner::None) };
    let id = std::str::from_utf8(&mark).ok().and_then(|id| Uuid::try_parse(id.trim()).ok());
    Ok(id.map_or(Owner::Unknown, Owner::Database))
}
