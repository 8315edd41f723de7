//! The slices of a stack in the order in which they are used.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The slices of an archive in the order in which they are used, and the size of all of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StackLayout {
    /// Names of the front-light slices, in order.
    pub front: Vec<String>,
    /// Names of the back-light slices, in order; empty without a back light.
    pub back: Vec<String>,
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// Bits per sample: 8 or 16 (the larger, when slices differ).
    pub bit_depth: u8,
    /// 1 grey or 3 RGB (the larger, when slices differ).
    pub channels: u8,
    /// EXIF orientation of the slices, 1 to 8, which was applied before width and height were taken; 1 without one.
    #[serde(default = "upright")]
    pub orientation: u8,
    /// Size of the largest file of a slice, unpacked; 0 when it was not recorded.
    #[serde(default)]
    pub largest_file_bytes: u64,
}

fn upright() -> u8 {
    1
}

impl StackLayout {
    /// The same slices in the opposite order.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.front.reverse();
        self.back.reverse();
        self
    }
}
