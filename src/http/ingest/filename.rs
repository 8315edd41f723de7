//! The file name that a client gave its zip. It is shown and used in the names of results, never as a path.

use axum::http::{HeaderMap, header};
use percent_encoding::percent_decode_str;

/// Longest name that is kept, in characters.
const MAX_CHARS: usize = 200;

/// The file name in the `Content-Disposition` of a request (RFC 6266).
pub fn of_request(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(header::CONTENT_DISPOSITION)?;
    let text = String::from_utf8_lossy(value.as_bytes());
    let parameters = parameters(&text);
    let parameter = |wanted: &str| {
        let found = parameters.iter().find(|(name, _)| name.eq_ignore_ascii_case(wanted));
        found.map(|(_, value)| value.clone())
    };
    let extended = parameter("filename*").and_then(|value| {
        let encoded = value.splitn(3, '\'').nth(2)?.to_owned();
        Some(percent_decode_str(&encoded).decode_utf8_lossy().into_owned())
    });
    tidy(&extended.or_else(|| parameter("filename"))?)
}

/// The parameters after the first part of a header, as names and values.
fn parameters(text: &str) -> Vec<(&str, String)> {
    let mut all = Vec::new();
    let mut rest = text.split_once(';').map_or("", |(_, rest)| rest);
    while !rest.is_empty() {
        let (name, after) = rest.split_at(rest.find([';', '=']).unwrap_or(rest.len()));
        rest = match after.strip_prefix('=') {
            Some(after) => {
                let (value, after) = value(after);
                all.push((name.trim(), value));
                after
            }
            // a name without a value
            None => after.strip_prefix(';').unwrap_or_default(),
        };
    }
    all
}

/// The value at the beginning of a text, a word or a quoted string, and the text after the next `;`.
fn value(text: &str) -> (String, &str) {
    let Some(quoted) = text.trim_start().strip_prefix('"') else {
        let (value, rest) = text.split_once(';').unwrap_or((text, ""));
        return (value.trim().to_owned(), rest);
    };
    let mut value = String::new();
    let mut rest = quoted.chars();
    while let Some(c) = rest.next() {
        match c {
            '"' => break,
            // any other backslash is of a Windows path that the client did not escape
            '\\' if rest.as_str().starts_with(['"', '\\']) => value.extend(rest.next()),
            c => value.push(c),
        }
    }
    (value, rest.as_str().split_once(';').map_or("", |(_, rest)| rest))
}

/// The last segment of a path without control characters; `None` when nothing remains.
pub fn tidy(name: &str) -> Option<String> {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let clean: String = last.chars().filter(|c| !c.is_control()).take(MAX_CHARS).collect();
    let clean = clean.trim();
    (!clean.is_empty()).then(|| clean.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn named(value: &'static str) -> Option<String> {
        of_request(&HeaderMap::from_iter([(header::CONTENT_DISPOSITION, HeaderValue::from_static(value))]))
    }

    #[test]
    fn a_file_name_is_read_from_both_forms_without_its_folders() {
        assert_eq!(named("attachment; filename=\"C:\\\\stacks\\\\bee 01.zip\"").as_deref(), Some("bee 01.zip"));
        assert_eq!(named("attachment; filename=a.zip; filename*=UTF-8''k%C3%A4fer.zip").as_deref(), Some("käfer.zip"));
        assert_eq!(named("attachment"), None);
        assert_eq!(named("attachment; filename=\"C:\\stacks\\bee.zip\"").as_deref(), Some("bee.zip"), "not escaped");
        assert_eq!(tidy("../../etc/passwd").as_deref(), Some("passwd"));
        assert_eq!(tidy("folder/"), None);
    }

    #[test]
    fn a_quoted_file_name_may_contain_semicolons_and_quotes() {
        for (value, expected) in [
            ("attachment; filename=\"bee;left.zip\"", "bee;left.zip"),
            ("attachment; filename=\"a; filename=b.zip\"; size=7", "a; filename=b.zip"),
            ("attachment; note=\"x; filename=b.zip\"; FileName = \"a.zip\"", "a.zip"),
            ("attachment; filename=\"the \\\"old\\\" bee.zip\"", "the \"old\" bee.zip"),
            ("attachment; filename=\"a;b.zip\"; filename*=UTF-8''k%C3%A4fer%3B1.zip", "käfer;1.zip"),
            ("attachment; inline; filename=a.zip", "a.zip"),
            ("attachment; filename=\"never;closed.zip", "never;closed.zip"),
        ] {
            assert_eq!(named(value).as_deref(), Some(expected), "{value}");
        }
        for value in ["attachment; filename=", "attachment; filename=\"\"", "attachment; filename=\"", ";;=;\"", ""] {
            assert_eq!(named(value), None, "{value}");
        }
    }
}
