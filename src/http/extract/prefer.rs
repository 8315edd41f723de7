//! `Prefer: wait=N` (RFC 7240).

use std::time::Duration;

use axum::http::{HeaderMap, HeaderName};

/// The request header.
pub const PREFER: HeaderName = HeaderName::from_static("prefer");
/// The response header with the granted preference.
pub const PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");

/// Longest wait, seconds. Many proxies end a request that was silent for 60 s: the answer must be there before.
pub const MAX_WAIT_S: u64 = 50;

/// How long the client prefers to wait for the end of the job. Unknown preferences are ignored, as RFC 7240 requires.
pub fn wait(headers: &HeaderMap) -> Option<Duration> {
    headers
        .get_all(PREFER)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split([',', ';']))
        .find_map(|preference| {
            let (name, seconds) = preference.split_once('=')?;
            let seconds = seconds.trim().trim_matches('"').parse::<u64>().ok()?;
            name.trim().eq_ignore_ascii_case("wait").then(|| Duration::from_secs(seconds.min(MAX_WAIT_S)))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waited(value: &'static str) -> Option<u64> {
        let headers = HeaderMap::from_iter([(PREFER, axum::http::HeaderValue::from_static(value))]);
        wait(&headers).map(|d| d.as_secs())
    }

    #[test]
    fn a_wait_is_found_among_other_preferences_and_capped() {
        assert_eq!(waited("wait=30"), Some(30));
        assert_eq!(waited("respond-async, wait=5"), Some(5));
        assert_eq!(waited("wait=60"), Some(50));
        assert_eq!(waited("wait=100000"), Some(50));
        assert_eq!(waited("wait=soon"), None);
        assert_eq!(waited("return=minimal"), None);
    }
}
