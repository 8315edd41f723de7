//! The pages of profiles and of calibrations.

pub mod calibration;
pub mod camera;
pub mod drift_plot;
pub mod list;
pub mod page;
