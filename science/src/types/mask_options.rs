//! How the object is cut out with the back light.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::text_or_number::TextOrNumber;

/// A threshold found in the picture or given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TextOrNumber", into = "String")]
pub enum MaskThreshold {
    /// Half-way between the object and the back light, which is made even first.
    #[default]
    Auto,
    /// Share of full scale, 0 to 1: darker is object.
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

/// What the alpha of the image is at the edge of the object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskEdge {
    /// 0 or full: what tools for reconstruction ask for.
    #[default]
    Hard,
    /// The share of the pixel that is object, so that hairs keep their width. The separate mask stays hard.
    Soft,
}
