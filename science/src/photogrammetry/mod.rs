//! From fused views to a reconstruction: bundles for reconstruction programs, and reports on the poses they find.

pub mod bundle;
pub mod missing_views;
pub mod outliers;
pub mod poses;
mod statistics;
