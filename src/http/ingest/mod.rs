//! From the bytes of a request to a job: everything between a client's zip and a queued row.
//!
//! | step | files |
//! |---|---|
//! | 1. Who sends the request, and does it repeat an earlier one? | [`request`], [`idempotency`] |
//! | 2. Names, options and profile are checked before the body is read. | [`submission`], [`fields`], [`receivable`] |
//! | 3. Length, disk budget, quota and queue are checked. | [`admission`], [`reservation`], [`quota`] |
//! | 4. The body is streamed to a spool file, counted and hashed. | [`receive`], [`multipart`], [`form_body`], [`body`], [`spool`], [`filename`] |
//! | 5. Directory and headers of the zip are checked; the file becomes a blob, the job a row. | [`submit`], [`many`], [`scan_views`] |
//! | 6. Only then does the client receive 202. | [`accept`] |
//!
//! The imports have no circles: to read a file, only those that it imports are needed. A rerun of a stack takes a
//! stored zip and skips step 4 only. Resumable uploads share steps 2, 3 and 5.

mod accept;
pub mod admission;
pub mod body;
pub mod fields;
pub mod filename;
pub mod form_body;
pub mod idempotency;
pub mod many;
mod multipart;
pub mod quota;
pub mod receivable;
mod receive;
pub mod request;
pub mod reservation;
pub mod scan_views;
pub mod spool;
pub mod submission;
pub mod submit;
