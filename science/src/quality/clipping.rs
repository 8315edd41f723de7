//! When a pixel counts as clipped.

/// A pixel is clipped at a luma (0..255) of `FULL` and above, or below `ZERO`.
pub(super) const FULL: f32 = 254.0;
pub(super) const ZERO: f32 = 0.5;
