//! Options of the mask: how the object is segmented in the back light.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::text_or_number::TextOrNumber;

/// The threshold between object and background.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TextOrNumber", into = "String")]
pub enum MaskThreshold {
    /// Found in the picture: half-way between object and background, after the light was made even.
    #[default]
    Auto,
    /// A share of full scale, 0 to 1: darker pixels are object.
    Fixed(f64),
}

impl TryFrom<TextOrNumber> for MaskThreshold {
    type Error = String;
    fn try_from(value: TextOrNumber) -> Result<Self, String> {
        let text = value.into_text();
        if text == "auto" {
            return Ok(Self::Auto);
        }
        match text.parse::<f64>() {
            Ok(value) if (0.0..=1.0).contains(&value) => Ok(Self::Fixed(value)),
            _ => Err(format!("mask_threshold is '{text}'; it must be 'auto' or a number from 0 to 1")),
        }
    }
}

impl From<MaskThreshold> for String {
    fn from(threshold: MaskThreshold) -> Self {
        match threshold {
            MaskThreshold::Auto => "auto".into(),
            MaskThreshold::Fixed(value) => value.to_string(),
        }
    }
}

/// The alpha of the image at the edge of the object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskEdge {
    /// 0 or full, as most reconstruction tools expect.
    #[default]
    Hard,
    /// The share of the pixel that the object covers, so that hairs keep their width. The separate mask stays hard.
    Soft,
}
