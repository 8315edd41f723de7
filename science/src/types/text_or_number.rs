//! Option values that JSON may write as a number and a query string can only write as text.

use serde::Deserialize;

/// JSON writes `8` where a query string can only write `"8"`: both mean the same.
#[derive(Deserialize)]
#[serde(untagged)]
pub enum TextOrNumber {
    /// `"8"`.
    Text(String),
    /// `8`.
    Number(serde_json::Number),
}

impl TextOrNumber {
    /// The value as text.
    pub fn into_text(self) -> String {
        match self {
            Self::Text(text) => text,
            Self::Number(number) => number.to_string(),
        }
    }
}
