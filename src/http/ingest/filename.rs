//! The file name that a client gave its zip. It is shown and used in the names of results, never as a path.

use std::borrow::Cow;

use axum::http::{HeaderMap, header};
use percent_encoding::percent_decode_str;

use crate::{
    contract::Code,
    http::{ApiError, ApiResult},
};

/// Longest name that is kept, in characters.
const MAX_CHARS: usize = 200;

/// The file name in the `Content-Disposition` of a request or of a part of a form (RFC 6266).
///
/// # Errors
/// `invalid_request` for a name that is not UTF-8.
pub fn of_headers(headers: &HeaderMap) -> ApiResult<Option<String>> {
    let Some(value) = headers.get(header::CONTENT_DISPOSITION) else { return Ok(None) };
    let text = str::from_utf8(value.as_bytes()).map_err(|_| not_utf8("filename"))?;
    let parameters = parameters(text);
    let parameter = |wanted: &str| {
        let found = parameters.iter().find(|(name, _)| name.eq_ignore_ascii_case(wanted));
        found.map(|(_, value)| value.clone())
    };
    let extended = parameter("filename*").and_then(|value| {
        let mut parts = value.splitn(3, '\'');
        let (charset, encoded) = (parts.next().unwrap_or_default(), parts.nth(1)?);
        let is_utf8 = charset.eq_ignore_ascii_case("utf-8") || (encoded.is_ascii() && !encoded.contains('%'));
        let name = percent_decode_str(encoded).decode_utf8().ok().filter(|_| is_utf8);
        Some(name.ok_or_else(|| not_utf8("filename*")).map(Cow::into_owned))
    });
    Ok(extended.transpose()?.or_else(|| parameter("filename")).and_then(|name| tidy(&name)))
}

fn not_utf8(parameter: &str) -> ApiError {
    let detail = format!(
        "{parameter} in Content-Disposition is not UTF-8; write it like filename*=UTF-8''K%C3%A4fer.zip, or omit it"
    );
    ApiError::new(Code::InvalidRequest, detail)
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
        of_bytes(value.as_bytes()).expect(value)
    }

    fn of_bytes(value: &[u8]) -> Result<Option<String>, String> {
        let value = HeaderValue::from_bytes(value).expect("a header");
        let named = of_headers(&HeaderMap::from_iter([(header::CONTENT_DISPOSITION, value)]));
        named.map_err(|error| error.fault().detail.clone())
    }

    #[test]
    fn a_name_that_is_not_utf8_is_refused_with_its_parameter() {
        for (value, parameter) in [
            (&b"attachment; filename*=UTF-8''K%E4fer.zip"[..], "filename* "),
            (b"attachment; filename=a.zip; filename*=UTF-8''K%E4fer.zip", "filename* "),
            (b"attachment; filename*=ISO-8859-1''K%E4fer.zip", "filename* "),
            (b"attachment; filename*=ISO-8859-1''K%C3%A4fer.zip", "filename* "),
            (b"attachment; filename=\"K\xe4fer.zip\"", "filename "),
        ] {
            let detail = of_bytes(value).expect_err(parameter);
            assert!(detail.starts_with(parameter) && detail.contains("not UTF-8"), "{detail}");
        }
        assert_eq!(named("form-data; filename*=iso-8859-1'en'bee.zip").as_deref(), Some("bee.zip"));
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
