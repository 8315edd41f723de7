//! Option values that are text in a query string and may be a number in JSON.

use serde::Deserialize;

/// A value as text (`"8"`) or as a number (`8`). Both are equivalent.
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
