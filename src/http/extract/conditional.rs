//! `ETag`, `If-Match` and `If-None-Match` (RFC 9110, section 13).

use axum::http::{HeaderMap, HeaderName, HeaderValue, header};

use crate::{
    contract::Code,
    http::problem::{ApiError, ApiResult},
    store::Precondition,
};

/// A list of entity tags, or any.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Tags {
    /// `*`
    Any,
    /// Opaque tags without quotes, with their weakness.
    List(Vec<(bool, String)>),
}

impl Tags {
    /// The tags of a header; `None` when it is absent.
    pub fn of(headers: &HeaderMap, name: &HeaderName) -> Option<Self> {
        let mut list = Vec::new();
        let mut present = false;
        for value in headers.get_all(name) {
            present = true;
            let text = value.to_str().unwrap_or_default().trim();
            if text == "*" {
                return Some(Self::Any);
            }
            list.extend(text.split(',').filter_map(tag));
        }
        present.then_some(Self::List(list))
    }

    /// Strong comparison, for writes and ranges.
    pub fn contains_strong(&self, opaque: &str) -> bool {
        match self {
            Self::Any => true,
            Self::List(tags) => tags.iter().any(|(weak, tag)| !weak && tag == opaque),
        }
    }

    /// Weak comparison, for `If-None-Match`.
    pub fn contains(&self, opaque: &str) -> bool {
        match self {
            Self::Any => true,
            Self::List(tags) => tags.iter().any(|(_, tag)| tag == opaque),
        }
    }
}

/// One entity tag. Missing quotes are tolerated.
fn tag(text: &str) -> Option<(bool, String)> {
    let text = text.trim();
    let (weak, opaque) = match text.strip_prefix("W/") {
        Some(rest) => (true, rest),
        None => (false, text),
    };
    let opaque = opaque.trim_matches('"');
    (!opaque.is_empty()).then(|| (weak, opaque.to_owned()))
}

/// Whether the client already has this version.
pub fn not_modified(headers: &HeaderMap, opaque: &str) -> bool {
    Tags::of(headers, &header::IF_NONE_MATCH).is_some_and(|tags| tags.contains(opaque))
}

/// Requires that `If-Match` names this version, if it is given. `If-Unmodified-Since` is ignored, as RFC 9110 requires
/// where no answer has `Last-Modified`.
///
/// # Errors
/// `precondition_failed`.
pub fn require_match(headers: &HeaderMap, opaque: &str) -> ApiResult<()> {
    match Tags::of(headers, &header::IF_MATCH) {
        Some(tags) if !tags.contains_strong(opaque) => {
            let detail = "the file is not the version that If-Match names; omit If-Match to get the current file";
            Err(ApiError::new(Code::PreconditionFailed, detail))
        }
        _ => Ok(()),
    }
}

/// The condition of a write in `If-Match` and `If-None-Match`, where the tag is a number that grows with each write.
/// `If-Match` holds if one of its tags is the current number; `current` is read only for that. `Err`: it does not hold.
///
/// # Errors
/// Those of `current`.
pub async fn precondition(
    headers: &HeaderMap,
    current: impl Future<Output = ApiResult<Option<u32>>>,
) -> ApiResult<Result<Precondition, Option<u32>>> {
    if Tags::of(headers, &header::IF_NONE_MATCH) == Some(Tags::Any) {
        return Ok(Ok(Precondition::Absent));
    }
    let list = match Tags::of(headers, &header::IF_MATCH) {
        None => return Ok(Ok(Precondition::Any)),
        Some(Tags::Any) => return Ok(Ok(Precondition::Present)),
        Some(list) => list,
    };
    let current = current.await?;
    Ok(match current {
        Some(number) if list.contains_strong(&number.to_string()) => Ok(Precondition::Revision(number)),
        _ => Err(current),
    })
}

/// The header value of a strong tag.
pub fn etag(opaque: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("\"{opaque}\"")).unwrap_or_else(|_| HeaderValue::from_static("\"\""))
}
