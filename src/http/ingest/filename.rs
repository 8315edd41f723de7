//! The file name that a client gave its zip. It is shown and used in the names of results, never as a path.

use axum::http::{HeaderMap, header};
use percent_encoding::percent_decode_str;

/// Longest name that is kept, in characters.
const MAX_CHARS: usize = 200;

/// The file name in the `Content-Disposition` of a request (RFC 6266).
pub fn of_request(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(header::CONTENT_DISPOSITION)?;
    let text = String::from_utf8_lossy(value.as_bytes());
    let parameter = |wanted: &str| {
        text.split(';').skip(1).find_map(|part| {
            let (name, value) = part.split_once('=')?;
            name.trim().eq_ignore_ascii_case(wanted).then(|| value.trim().trim_matches('"').to_owned())
        })
    };
    let extended = parameter("filename*").and_then(|value| {
        let encoded = value.splitn(3, '\'').nth(2)?.to_owned();
        Some(percent_decode_str(&encoded).decode_utf8_lossy().into_owned())
    });
    tidy(&extended.or_else(|| parameter("filename"))?)
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
        assert_eq!(tidy("../../etc/passwd").as_deref(), Some("passwd"));
        assert_eq!(tidy("folder/"), None);
    }
}
