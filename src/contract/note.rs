//! Notes: what people write about a stack, a scan or a profile.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{Code, Fault, Name};
use pinstack_science::types::error::ErrorLocation;

/// Longest text, in characters.
pub const MAX_CHARACTERS: usize = 2000;
/// Most notes about one object.
pub const MAX_NOTES: usize = 100;

/// A note about a stack, a scan or a profile.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Note {
    /// Id.
    pub id: Uuid,
    /// The text; lines end with `\n`.
    pub text: String,
    /// Name of the token that wrote it; null if no token was required.
    pub author: Option<Name>,
    /// When it was written.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
}

/// A note that is to be written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NoteInput {
    /// The text, without white space at its ends.
    #[schema(min_length = 1, max_length = 2000)]
    pub text: String,
}

impl NoteInput {
    /// The text as it is stored: lines end with `\n`, and there is no white space at the ends.
    ///
    /// # Errors
    /// [`Code::InvalidRequest`] unless that has 1 to 2,000 characters, which are no control characters but tabs.
    pub fn checked(&self) -> Result<String, Fault> {
        let text = self.text.replace("\r\n", "\n").trim().to_owned();
        let rule = match text.chars().count() {
            0 => "has no characters but white space; write 1 to 2,000 characters".to_owned(),
            n if n > MAX_CHARACTERS => format!("has {n} characters; write at most 2,000, and the rest in another note"),
            _ if text.chars().any(|c| c.is_control() && c != '\n' && c != '\t') => {
                "contains a control character; only line ends and tabs are allowed".to_owned()
            }
            _ => return Ok(text),
        };
        let detail = format!("the text of the note {rule}");
        let place = ErrorLocation { detail: detail.clone(), pointer: Some("/text".into()), ..ErrorLocation::default() };
        Err(Fault::new(Code::InvalidRequest, detail).at(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_trimmed_and_has_1_to_2000_characters() {
        let checked = |text: &str| NoteInput { text: text.into() }.checked();
        assert_eq!(checked(" K\u{e4}fer\r\n\tleft wing \n").as_deref(), Ok("K\u{e4}fer\n\tleft wing"));
        assert!(checked(&"\u{4f60}".repeat(2000)).is_ok());
        for (wrong, why) in [(" \n", "no characters"), (&"x".repeat(2001), "has 2001"), ("a\0b", "control character")] {
            let fault = checked(wrong).expect_err("it is refused");
            assert!(fault.detail.contains(why), "{fault:?}");
            assert_eq!((fault.code, fault.locations.len()), (Code::InvalidRequest, 1));
        }
    }
}
