//! The key of the bucket, from a file: other users of the machine can read flags, and a container gets secrets as
//! files.

use std::path::Path;

use anyhow::Context;

/// A key of the bucket.
pub(super) struct Key {
    pub(super) id: String,
    pub(super) secret: String,
    pub(super) token: Option<String>,
}

/// Reads the first profile of a file in the format of `~/.aws/credentials`: lines `name = value`; lines in brackets
/// begin a profile.
///
/// # Errors
/// When the file cannot be read, or has no key. The message never repeats its content.
pub(super) fn read(file: &Path) -> anyhow::Result<Key> {
    let what = || format!("storage_credentials_file: {}", file.display());
    let text = std::fs::read_to_string(file).with_context(what)?;
    of_text(&text)
        .with_context(|| format!("{} must have lines aws_access_key_id = ... and aws_secret_access_key = ...", what()))
}

fn of_text(text: &str) -> Option<Key> {
    let (mut id, mut secret, mut token) = (None, None, None);
    let mut profiles = 0;
    for line in text.lines().map(str::trim) {
        if line.starts_with('[') {
            profiles += 1;
            if profiles > 1 {
                break;
            }
        }
        let Some((name, value)) = line.split_once('=') else { continue };
        let value = Some(value.trim().to_owned()).filter(|value| !value.is_empty());
        match name.trim() {
            "aws_access_key_id" => id = value,
            "aws_secret_access_key" => secret = value,
            "aws_session_token" => token = value,
            _ => {}
        }
    }
    Some(Key { id: id?, secret: secret?, token })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_profile_counts() {
        let text =
            "# lab\n[default]\naws_access_key_id = A\naws_secret_access_key=b=c\n[other]\naws_access_key_id = B\n";
        let key = of_text(text).expect("a key");
        assert_eq!((key.id.as_str(), key.secret.as_str(), key.token), ("A", "b=c", None));
        let key = of_text("aws_access_key_id=A\naws_secret_access_key=b\naws_session_token=t").expect("a key");
        assert_eq!(key.token.as_deref(), Some("t"));
    }

    #[test]
    fn a_file_without_key_is_refused_without_repeating_it() {
        assert!(of_text("aws_access_key_id = A\naws_secret_access_key =\n").is_none());
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), "geheim").expect("written");
        let error = format!("{:?}", read(file.path()).err().expect("no key"));
        assert!(error.contains("aws_secret_access_key") && !error.contains("geheim"), "{error}");
    }
}
