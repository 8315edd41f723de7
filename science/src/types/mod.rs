//! Types that all modules share: homographies, profiles, options, metrics, reports, errors.
//!
//! They check their rules and convert themselves from other forms. This module imports no other module of the crate.

pub mod calibration_options;
pub mod capture_mode;
pub mod control;
pub mod distortion;
pub mod error;
pub mod fusion_options;
pub mod height;
pub mod homography;
pub mod intrinsics;
pub mod lateral_colour;
pub mod lens;
pub mod mask_options;
pub mod matrices;
pub mod metrics;
pub mod pinhole;
pub mod profile;
pub mod pupils;
pub mod read_at;
pub mod report;
pub mod rig_parameters;
pub mod stack_layout;
pub mod text;
pub mod text_or_number;
pub mod view;
pub mod warning_code;

pub use control::{Cancelled, Control, Interrupted, NoControl};
pub use error::{Error, ErrorKind, Warning};
pub use homography::Homography;
pub use read_at::ReadAt;
pub use warning_code::WarningCode;
