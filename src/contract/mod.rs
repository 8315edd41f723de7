//! Data types that clients see and that the database stores: jobs, requests, outcomes, profiles, error codes.
//!
//! Plain data with its validation rules. The numeric types of the science are in `pinstack_science::types`.

pub mod artifact;
pub mod error;
pub mod input;
pub mod job;
pub mod job_error;
pub mod name;
pub mod note;
pub mod one_line;
pub mod options;
pub mod outcome;
pub mod priority;
pub mod profile;
pub mod profile_summary;
pub mod ranges;
pub mod reconstruction;
pub mod request;
pub mod scan;
pub mod upload;
pub mod upload_purpose;
pub mod verdict;

pub use error::{Code, Fault, Problem};
pub use job::{JobKind, JobState, Progress};
pub use job_error::JobError;
pub use name::Name;
pub use note::Note;
pub use one_line::one_line;
pub use priority::Priority;
pub use profile_summary::ProfileSummary;
pub use scan::{Scan, ScanInput};
pub use upload_purpose::UploadPurpose;
pub use verdict::Verdict;
