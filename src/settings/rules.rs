//! Rules and conversions of single values.

use std::time::Duration;

use super::address_range::AddressRange;

/// Scheme and host, optionally a port, and nothing else.
pub(super) fn is_origin(text: &str) -> bool {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    host.is_some_and(|host| {
        !host.is_empty() && host.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-.:[]".contains(&b))
    })
}

/// Scheme and host, optionally a port and a path; no user, query or fragment.
pub(super) fn is_base_url(text: &str) -> bool {
    let Ok(url) = text.parse::<hyper::Uri>() else { return false };
    let is_http = ["http", "https"].contains(&url.scheme_str().unwrap_or_default());
    let host = url.authority().map(hyper::http::uri::Authority::as_str).unwrap_or_default();
    is_http && !host.is_empty() && !host.contains('@') && !text.contains(['?', '#'])
}

/// A host name without scheme, port or path.
pub(super) fn is_host(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._".contains(&b))
}

/// The absolute path of a program, and arguments of which one says where the output goes.
pub(super) fn is_mesh_command(words: &[String]) -> bool {
    words.split_first().is_some_and(|(program, arguments)| {
        program.starts_with('/') && arguments.iter().any(|argument| argument.contains("{output}"))
    })
}

/// The ranges that the texts give; the rule of the setting refuses others.
pub(super) fn ranges(texts: Vec<String>) -> Vec<AddressRange> {
    texts.iter().filter_map(|text| text.parse().ok()).collect()
}

/// So many seconds; `None` for 0.
pub(super) fn seconds_if_any(seconds: u64) -> Option<Duration> {
    (seconds > 0).then(|| Duration::from_secs(seconds))
}
