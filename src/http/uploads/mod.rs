//! Resumable uploads (tus 1.0.0): one method per file.
//!
//! 1. A request locks the upload, taking it over from an older request if necessary ([`lock`]).
//! 2. Its bytes are written and synced, then the row records the new offset ([`receive`]).
//! 3. Only then does the client receive the offset.
//! 4. The last bytes make the job ([`complete`]). A client that missed the response asks again by `HEAD`.

pub mod checksum;
pub mod complete;
pub mod create;
pub mod delete;
pub mod digest;
pub mod get;
pub mod head;
pub mod list;
pub mod lock;
pub mod metadata;
pub mod options;
pub mod patch;
pub mod protocol;
pub mod receive;
