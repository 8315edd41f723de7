//! Resumable uploads: tus 1.0.0, one verb per file.
//!
//! The way of a piece: the request takes the upload over from the one before it ([`hold`]), its bytes are written and
//! synced, then the row says so ([`receive`]), then the client hears the offset. The last piece makes the job
//! ([`complete`]); a client that did not hear of it asks again and is told, however often.

pub mod checksum;
pub mod complete;
pub mod create;
pub mod delete;
pub mod digest;
pub mod get;
pub mod head;
pub mod hold;
pub mod list;
pub mod metadata;
pub mod options;
pub mod patch;
pub mod protocol;
pub mod receive;
