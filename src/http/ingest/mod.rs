//! From the bytes of a request to a job: everything between a client's zip and a queued row.
//!
//! 1. Checked before the body is read: names, options, profile, length, disk budget, quota, queue ([`submission`],
//!    [`admission`]).
//! 2. The body is streamed to a spool file, counted and hashed ([`receive`], [`multipart`], [`spool`]).
//! 3. The directory of the zip and the headers of its images are checked; the file becomes a blob and the job a row
//!    ([`submit`]).
//! 4. Only then does the client receive 202 ([`accept`]).
//!
//! Resumable uploads and reruns bring their zip in another way and share steps 1 and 3.

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
