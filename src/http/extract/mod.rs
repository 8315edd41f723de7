//! Requests taken apart: like axum's extractors, but every refusal is a problem that says what to do.

pub mod conditional;
pub mod json;
mod json_sentence;
pub mod page;
pub mod params;
pub mod path;
pub mod prefer;
pub mod sent;

pub use conditional::{Conditional, Numbered, etag, not_modified};
pub use page::PageQuery;
pub use path::{JobId, ProfileKey, UploadId};
pub use sent::Sent;
