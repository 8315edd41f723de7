//! What an upload becomes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What an upload becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UploadPurpose {
    /// A stack to fuse.
    Stack,
    /// A dot target to calibrate from.
    Calibration,
    /// The stacks of a scan, one per view.
    Scan,
}

impl UploadPurpose {
    /// All purposes.
    pub const ALL: [Self; 3] = [Self::Stack, Self::Calibration, Self::Scan];

    /// Its name in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stack => "stack",
            Self::Calibration => "calibration",
            Self::Scan => "scan",
        }
    }

    /// The purpose with this name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|purpose| purpose.as_str() == name)
    }
}
