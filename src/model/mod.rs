//! Plain types of the domain: what the HTTP contract shows and what the science passes around.
//!
//! Nothing here does work beyond checking its own rules; this module imports no other module.

pub mod control;
pub mod error;
pub mod homography;
pub mod input;
pub mod intrinsics;
pub mod job;
pub mod matrices;
pub mod metrics;
pub mod name;
pub mod one_line;
pub mod options;
pub mod outcome;
pub mod profile;
pub mod profile_summary;
pub mod report;
pub mod request;
pub mod rig_parameters;

pub use control::{Cancelled, Control, Stop, Unwatched};
pub use error::{Code, Fault, Problem, Warning};
pub use homography::Homography;
pub use job::{JobKind, JobState, Progress};
pub use name::Name;
pub use one_line::one_line;
pub use profile_summary::ProfileSummary;
