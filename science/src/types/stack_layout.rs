//! The ordered slices of a stack, and their common properties.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The ordered slices of an archive, and their common properties.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StackLayout {
    /// Names of the front-light slices, in order.
    pub front: Vec<String>,
    /// Names of the back-light slices, in order; empty without a back light.
    pub back: Vec<String>,
    /// The further lights, by name; none of them in a calibration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<FurtherLight>,
    /// Names of the slices of the moved target of a calibration, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moved: Vec<String>,
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// Bits per sample, 8 or 16; the maximum when slices differ.
    pub bit_depth: u8,
    /// Channels, 1 grey or 3 RGB; the maximum when slices differ.
    pub channels: u8,
    /// EXIF orientation of the slices, 1 to 8; 1 without a tag. Width and height refer to the upright slices.
    #[serde(default = "upright")]
    pub orientation: u8,
    /// Uncompressed size of the largest slice file, bytes; 0 when it was not recorded.
    #[serde(default)]
    pub largest_file_bytes: u64,
}

/// A further light of a stack: the same view, taken again at the same rail positions under another light.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FurtherLight {
    /// The name of its folder: 1 to 32 letters, digits, `-` and `_`.
    pub name: String,
    /// Names of its slices, in order; as many as of the front light.
    pub slices: Vec<String>,
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
        self.lights.iter_mut().for_each(|light| light.slices.reverse());
        self
    }
}
