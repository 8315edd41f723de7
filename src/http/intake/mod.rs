//! The way of an upload: everything that can be known is checked before the body is read; the body is streamed
//! to a spool file, counted and hashed; the zip's directory and image headers are checked; then the file becomes
//! a blob and the job a row, and only then the client hears 202.

pub mod accept;
pub mod admission;
pub mod body;
pub mod filename;
pub mod form_body;
pub mod idempotency;
pub mod multipart;
pub mod order;
pub mod quota;
pub mod receive;
pub mod reservation;
pub mod spool;
pub mod submit;
