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
///
/// | header | holds if |
/// |---|---|
/// | `If-Match: *` | there is a current number |
/// | `If-Match` with tags | one of them is the current number |
/// | `If-None-Match: *` | there is no current number |
/// | `If-None-Match` with tags | none of them is the current number |
///
/// The store checks a single `*` in the transaction of the write. Otherwise `current` is read, and the write requires
/// that it is still the same. `Err`: `If-Match` does not hold.
///
/// # Errors
/// `precondition_failed` when `If-None-Match` does not hold; those of `current`.
pub async fn precondition(
    headers: &HeaderMap,
    current: impl Future<Output = ApiResult<Option<u32>>>,
) -> ApiResult<Result<Precondition, Option<u32>>> {
    let (wanted, excluded) = (Tags::of(headers, &header::IF_MATCH), Tags::of(headers, &header::IF_NONE_MATCH));
    match (&wanted, &excluded) {
        (None, None) => return Ok(Ok(Precondition::Any)),
        (Some(Tags::Any), None) => return Ok(Ok(Precondition::Present)),
        (None, Some(Tags::Any)) => return Ok(Ok(Precondition::Absent)),
        _ => {}
    }
    let current = current.await?;
    let tag = current.map(|number| number.to_string());
    let is_in = |tags: Tags, contains: fn(&Tags, &str) -> bool| tag.as_ref().is_some_and(|tag| contains(&tags, tag));
    if wanted.is_some_and(|wanted| !is_in(wanted, Tags::contains_strong)) {
        return Ok(Err(current));
    }
    if excluded.is_some_and(|excluded| is_in(excluded, Tags::contains)) {
        let detail = format!(
            "nothing was changed: the current version is {}, which If-None-Match excludes; omit that header to change \
             it",
            tag.unwrap_or_default()
        );
        return Err(ApiError::new(Code::PreconditionFailed, detail));
    }
    Ok(Ok(current.map_or(Precondition::Absent, Precondition::Revision)))
}

/// The header value of a strong tag.
pub fn etag(opaque: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("\"{opaque}\"")).unwrap_or_else(|_| HeaderValue::from_static("\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn condition(headers: &[(HeaderName, &'static str)], current: Option<u32>) -> Result<Precondition, Code> {
        let headers = headers.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value)));
        match precondition(&headers.collect(), async { Ok(current) }).await {
            Ok(Ok(condition)) => Ok(condition),
            Ok(Err(now)) => {
                assert_eq!(now, current);
                Err(Code::PreconditionFailed)
            }
            Err(error) => Err(error.fault().code),
        }
    }

    #[tokio::test]
    async fn the_condition_of_a_write_follows_from_both_headers() {
        use Precondition::{Absent, Any, Present, Revision};
        let (only, none) = (header::IF_MATCH, header::IF_NONE_MATCH);
        let failed = Err(Code::PreconditionFailed);
        for (headers, current, expected) in [
            (vec![], Some(4), Ok(Any)),
            (vec![(&only, "*")], Some(4), Ok(Present)),
            (vec![(&only, "\"3\", \"4\"")], Some(4), Ok(Revision(4))),
            (vec![(&only, "W/\"4\"")], Some(4), failed),
            (vec![(&only, "\"4\"")], None, failed),
            (vec![(&none, "*")], Some(4), Ok(Absent)),
            (vec![(&none, "\"4\"")], Some(4), failed),
            (vec![(&none, "W/\"4\"")], Some(4), failed),
            (vec![(&none, "\"3\"")], Some(4), Ok(Revision(4))),
            (vec![(&none, "\"3\"")], None, Ok(Absent)),
            (vec![(&only, "\"4\""), (&none, "\"3\"")], Some(4), Ok(Revision(4))),
            (vec![(&only, "\"3\""), (&none, "*")], Some(4), failed),
            (vec![(&only, "\"4\""), (&none, "*")], Some(4), failed),
            (vec![(&only, "*"), (&none, "\"4\"")], Some(4), failed),
            (vec![(&only, "*"), (&none, "*")], None, failed),
        ] {
            let sent: Vec<_> = headers.into_iter().map(|(name, value)| (name.clone(), value)).collect();
            assert_eq!(condition(&sent, current).await, expected, "{sent:?}");
        }
    }
}
