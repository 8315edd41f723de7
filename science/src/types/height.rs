//! How to read the values of a height map.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Unit of a height map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightUnit {
    /// Millimetres in the object.
    Mm,
    /// Millimetres of travel of the rail: how the travel relates to the object is unknown.
    RailMm,
    /// Steps from slice to slice.
    Steps,
}

/// Direction in which the values of a height map increase.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightDirection {
    /// Larger values are nearer to the camera.
    TowardsCamera,
    /// Larger values are focused in later slices: which end of the stack is near is unknown.
    WithSliceNumber,
}
