//! What answers look like: the rows, without what is nobody's business (keys of blobs, leases).

pub mod calibration;
pub mod job;
pub mod list;
pub mod stack;

pub use calibration::Calibration;
pub use list::{CalibrationList, ProfileList, StackList};
pub use stack::Stack;
