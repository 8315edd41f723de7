//! The option `crop`.

use serde::{Deserialize, Serialize};

/// Part of the reference slice's canvas that the results show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Crop {
    /// All of it: every view has the same intrinsics.
    #[default]
    None,
    /// The largest rectangle that every slice covers. It depends only on the profile.
    Valid,
    /// A rectangle in reference-slice pixels.
    Rect {
        /// Left column.
        x: u32,
        /// Top row.
        y: u32,
        /// Width in px.
        width: u32,
        /// Height in px.
        height: u32,
    },
}

impl TryFrom<String> for Crop {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
        match (text.as_str(), numbers.as_deref()) {
            ("none", _) => Ok(Self::None),
            ("valid", _) => Ok(Self::Valid),
            (_, Some(&[x, y, width, height])) if width > 0 && height > 0 => Ok(Self::Rect { x, y, width, height }),
            _ => Err(format!("crop is '{text}'; it must be 'none', 'valid' or 'x,y,w,h' in px of the reference slice")),
        }
    }
}

impl From<Crop> for String {
    fn from(crop: Crop) -> Self {
        match crop {
            Crop::None => "none".into(),
            Crop::Valid => "valid".into(),
            Crop::Rect { x, y, width, height } => format!("{x},{y},{width},{height}"),
        }
    }
}
