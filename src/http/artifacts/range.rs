//! `Range: bytes=...` (RFC 9110, section 14). One range is supported; a request for several gets the whole file.
//! Requests other than `GET` have no `Range` here ([`crate::http::middleware::method`] removes it).

use axum::http::{HeaderMap, header};

use crate::http::extract::conditional::Tags;

/// The requested part of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// All of it.
    Whole,
    /// Bytes `first..=last`.
    Part {
        /// First byte.
        first: u64,
        /// Last byte, inclusive.
        last: u64,
    },
    /// A range beyond the end of the file.
    Unsatisfiable,
}

/// The part that the headers request from a file of `length` bytes with entity tag `tag`.
pub fn wanted(headers: &HeaderMap, length: u64, tag: &str) -> Wanted {
    let Some(range) = headers.get(header::RANGE).and_then(|v| v.to_str().ok()) else { return Wanted::Whole };
    // a date in If-Range never matches: no response carries one
    let is_other = Tags::of(headers, &header::IF_RANGE).is_some_and(|tags| !tags.contains_strong(tag));
    if is_other {
        return Wanted::Whole;
    }
    parse(range, length)
}

/// An invalid range is ignored, as the RFC requires.
fn parse(range: &str, length: u64) -> Wanted {
    let Some((first, last)) = range.trim().strip_prefix("bytes=").and_then(|r| r.split_once('-')) else {
        return Wanted::Whole;
    };
    let (first, last) = (first.trim(), last.trim());
    let end = length.saturating_sub(1);
    match (first.parse::<u64>(), last.parse::<u64>()) {
        (Ok(first), Ok(last)) if first > last => Wanted::Whole,
        (Ok(first), _) if first >= length && (last.is_empty() || last.parse::<u64>().is_ok()) => Wanted::Unsatisfiable,
        (Ok(first), Ok(last)) => Wanted::Part { first, last: last.min(end) },
        (Ok(first), Err(_)) if last.is_empty() => Wanted::Part { first, last: end },
        (Err(_), Ok(0)) if first.is_empty() => Wanted::Unsatisfiable,
        (Err(_), Ok(_)) if first.is_empty() && length == 0 => Wanted::Unsatisfiable,
        (Err(_), Ok(suffix)) if first.is_empty() => Wanted::Part { first: length.saturating_sub(suffix), last: end },
        _ => Wanted::Whole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_single_range_is_parsed() {
        let part = |first, last| Wanted::Part { first, last };
        assert_eq!(parse("bytes=0-9", 100), part(0, 9));
        assert_eq!(parse("bytes=90-", 100), part(90, 99));
        assert_eq!(parse("bytes=-10", 100), part(90, 99));
        assert_eq!(parse("bytes=-1000", 100), part(0, 99));
        assert_eq!(parse("bytes=50-1000", 100), part(50, 99));
        assert_eq!(parse("bytes=100-", 100), Wanted::Unsatisfiable);
        assert_eq!(parse("bytes=100-200", 100), Wanted::Unsatisfiable);
        assert_eq!(parse("bytes=-0", 100), Wanted::Unsatisfiable);
    }

    #[test]
    fn anything_but_a_single_valid_range_is_ignored() {
        for range in ["bytes=9-0", "bytes=0-1,5-6", "items=0-1", "bytes=a-b", "bytes=", "bytes=-"] {
            assert_eq!(parse(range, 100), Wanted::Whole, "{range}");
        }
    }
}
