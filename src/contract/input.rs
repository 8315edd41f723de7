//! How the slices of a stack are read.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::text_or_number::TextOrNumber;

/// Order of the slices relative to the profile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SliceOrder {
    /// Natural order of the names, or the order of `manifest.json`.
    #[default]
    Name,
    /// The reverse order: the rail moved in the opposite direction to the calibration.
    Reverse,
}

/// Significant bits of the samples in 16-bit files: `auto`, `10`, `12`, `14` or `16`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "TextOrNumber", into = "String")]
pub enum InputBits {
    /// Samples are used unchanged; a warning is given when they look like fewer bits.
    #[default]
    Auto,
    /// 0 to 1023 is the full scale.
    Ten,
    /// 0 to 4095 is the full scale.
    Twelve,
    /// 0 to 16383 is the full scale.
    Fourteen,
    /// 0 to 65535 is the full scale: samples are used unchanged, without a warning.
    Sixteen,
}

impl InputBits {
    /// The number of bits; `None` for [`InputBits::Auto`].
    pub fn bits(self) -> Option<u32> {
        match self {
            Self::Auto => None,
            Self::Ten => Some(10),
            Self::Twelve => Some(12),
            Self::Fourteen => Some(14),
            Self::Sixteen => Some(16),
        }
    }
}

impl TryFrom<TextOrNumber> for InputBits {
    type Error = String;
    fn try_from(value: TextOrNumber) -> Result<Self, String> {
        match value.into_text().as_str() {
            "auto" => Ok(Self::Auto),
            "10" => Ok(Self::Ten),
            "12" => Ok(Self::Twelve),
            "14" => Ok(Self::Fourteen),
            "16" => Ok(Self::Sixteen),
            text => Err(format!("input_bits is '{text}'; it must be 'auto', '10', '12', '14' or '16'")),
        }
    }
}

impl From<InputBits> for String {
    fn from(bits: InputBits) -> Self {
        bits.bits().map_or_else(|| "auto".into(), |bits| bits.to_string())
    }
}
