//! Names of rigs, lenses and scans.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A name: 1 to 64 characters of `A-Z a-z 0-9 . _ -`, not beginning with a dot. Safe in URLs and file names.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
#[serde(try_from = "String", into = "String")]
#[schema(value_type = String, min_length = 1, max_length = 64, pattern = "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}$")]
pub struct Name(String);

/// The error of an invalid name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("'{given}' is not a valid name: use 1 to 64 characters of A-Z a-z 0-9 . _ -, not beginning with a dot{}", suggested(.suggestion))]
pub struct InvalidName {
    given: String,
    suggestion: Option<Name>,
}

fn suggested(suggestion: &Option<Name>) -> String {
    suggestion.as_ref().map(|name| format!("; for example '{name}'")).unwrap_or_default()
}

/// The valid name nearest to a text: slashes and colons become hyphens, other forbidden characters underscores.
fn nearest(text: &str) -> Option<Name> {
    let mut name = String::new();
    for c in text.trim().chars().take(64) {
        let c = match c {
            c if c.is_ascii_alphanumeric() || "._-".contains(c) => c,
            '/' | '\\' | ':' => '-',
            _ => '_',
        };
        let is_leading_dot = name.is_empty() && c == '.';
        let is_repeated = c == '_' && name.ends_with('_');
        if !(is_leading_dot || is_repeated) {
            name.push(c);
        }
    }
    let has_a_letter = name.bytes().any(|b| b.is_ascii_alphanumeric());
    has_a_letter.then(|| Name(name.trim_end_matches('_').to_owned()))
}

impl Name {
    /// Validates a name.
    ///
    /// # Errors
    /// [`InvalidName`] with the first 80 characters of the text, the rule, and a suggestion.
    pub fn new(name: impl Into<String>) -> Result<Self, InvalidName> {
        let name = name.into();
        let fits = (1..=64).contains(&name.len())
            && !name.starts_with('.')
            && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b));
        if fits {
            return Ok(Self(name));
        }
        Err(InvalidName { given: name.chars().take(80).collect(), suggestion: nearest(&name) })
    }

    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for Name {
    type Error = InvalidName;
    fn try_from(name: String) -> Result<Self, InvalidName> {
        Self::new(name)
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_invalid_name_is_refused_with_a_suggestion() {
        for (text, name) in [
            ("MP-E 65mm f/2.8", Some("MP-E_65mm_f-2.8")),
            (" .hidden ", Some("hidden")),
            ("Zerene \u{2013} 5\u{d7}", Some("Zerene_5")),
            ("Prüfstand", Some("Pr_fstand")),
            ("", None),
            ("???", None),
        ] {
            let refused = Name::new(text).expect_err("it breaks the rule");
            assert_eq!(refused.suggestion.as_ref().map(Name::as_str), name, "{text}");
            assert_eq!(refused.to_string().contains("for example"), name.is_some(), "{refused}");
        }
        let long = Name::new("x".repeat(65)).expect_err("too long");
        assert_eq!(long.suggestion, Some(Name("x".repeat(64))));
    }
}
