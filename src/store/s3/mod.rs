//! Blobs and upload parts in a bucket of an S3-compatible object store, for several machines without a common folder.
//!
//! ```text
//! {prefix}/pinstack.store                                     whose bucket it is
//! {prefix}/pinstack.probe                                     written by /readyz
//! {prefix}/uploads/..., {prefix}/results/...                  blobs, by their keys
//! {prefix}/parts/{upload}/{first byte}-{end}-{generation}     bytes of a resumable upload
//! ```
//!
//! | question | answer |
//! |---|---|
//! | when is a blob durable | when the bucket has answered the request that completes it, and then tells the right size |
//! | how an upload becomes a blob | the bucket copies its parts: [`compose`] |
//! | who may write an upload | the request with the newest generation in its row: [`parts`] |
//! | who may collect garbage | processes on the database whose id is in `pinstack.store`: [`owner`] |
//! | what is local | the workspace: uploads that come in one request, scans, and what was read of a blob so far |
//!
//! The client is that of the crate `object_store`, over an HTTP connection of our own ([`http`]), because its built-in
//! one changes the TLS of every other HTTP client in the process.

mod blobs;
mod bucket;
mod compose;
mod credentials;
mod http;
mod location;
mod owner;
mod parts;
#[cfg(test)]
mod test_server;
#[cfg(test)]
mod tests;

pub use blobs::S3BlobStore;
pub use location::{S3Location, S3Url};
pub use parts::S3UploadParts;

use std::sync::Arc;

use uuid::Uuid;

use super::StoreResult;

/// Opens the bucket for the database with the id `store`, to which the bucket belongs from then on.
///
/// # Errors
/// When the settings are contradictory, the bucket does not answer, refuses the credentials, or belongs to another
/// database.
pub async fn open(location: &S3Location, store: Uuid) -> StoreResult<(S3BlobStore, S3UploadParts)> {
    let bucket = Arc::new(bucket::Bucket::connect(location)?);
    owner::claim(&bucket, store).await?;
    Ok((S3BlobStore::new(Arc::clone(&bucket)), S3UploadParts::new(bucket)))
}

/// Checks that the bucket answers and accepts the credentials, without changing anything.
///
/// # Errors
/// When the settings are contradictory, or it does not.
pub async fn inspect(location: &S3Location) -> StoreResult<()> {
    let bucket = bucket::Bucket::connect(location)?;
    // a question for one object does not tell a bucket that does not exist from one without the object
    bucket.names_below("parts").await.map(drop)
}
