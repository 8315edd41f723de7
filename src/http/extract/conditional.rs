//! `ETag`, `If-Match` and `If-None-Match` (RFC 9110, section 13).

use std::future::Future;

use axum::{
    Json,
    extract::FromRequestParts,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header, request::Parts},
    response::{IntoResponse, Response},
};
use serde::Serialize;

use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App},
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

/// A resource with a number that grows with each write, which is its tag.
pub trait Numbered {
    /// The word for the resource.
    const KIND: &'static str;
    /// The word for its number.
    const NUMBER: &'static str;

    /// Which resource, for error messages.
    fn subject(&self) -> String;

    /// Its URL.
    fn url(&self) -> String;

    /// The current number; `None` when the resource does not exist.
    fn current(&self, app: &App) -> impl Future<Output = ApiResult<Option<u32>>> + Send;
}

/// The resource that a URL names, and the conditions of the request in `If-Match` and `If-None-Match`. For a write:
///
/// | header | holds if |
/// |---|---|
/// | `If-Match: *` | there is a current number |
/// | `If-Match` with tags | one of them is the current number |
/// | `If-None-Match: *` | there is no current number |
/// | `If-None-Match` with tags | none of them is the current number |
#[derive(Debug, Clone)]
pub struct Conditional<T> {
    /// The resource.
    pub of: T,
    wanted: Option<Tags>,
    excluded: Option<Tags>,
}

impl<S: Send + Sync, T: FromRequestParts<S, Rejection = ApiError>> FromRequestParts<S> for Conditional<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> ApiResult<Self> {
        Ok(Self::new(T::from_request_parts(parts, state).await?, &parts.headers))
    }
}

impl<T> Conditional<T> {
    fn new(of: T, headers: &HeaderMap) -> Self {
        let (wanted, excluded) = (Tags::of(headers, &header::IF_MATCH), Tags::of(headers, &header::IF_NONE_MATCH));
        Self { of, wanted, excluded }
    }

    /// The condition of a write that the store checks by itself, in the transaction of the write.
    fn unread(&self) -> Option<Precondition> {
        match (&self.wanted, &self.excluded) {
            (None, None) => Some(Precondition::Any),
            (Some(Tags::Any), None) => Some(Precondition::Present),
            (None, Some(Tags::Any)) => Some(Precondition::Absent),
            _ => None,
        }
    }

    fn holds(&self, current: Option<u32>) -> Holds {
        let tag = current.map(|number| number.to_string());
        let is_in =
            |tags: &Tags, contains: fn(&Tags, &str) -> bool| tag.as_ref().is_some_and(|tag| contains(tags, tag));
        if self.wanted.as_ref().is_some_and(|wanted| !is_in(wanted, Tags::contains_strong)) {
            return Holds::NotMatched;
        }
        match current {
            Some(number) if self.excluded.as_ref().is_some_and(|tags| is_in(tags, Tags::contains)) => {
                Holds::Excluded(number)
            }
            current => Holds::Yes(current.map_or(Precondition::Absent, Precondition::Revision)),
        }
    }
}

/// Whether the conditions of a write hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Holds {
    /// They do. The write requires that the number is still the same.
    Yes(Precondition),
    /// `If-Match` does not name the current number.
    NotMatched,
    /// `If-None-Match` names the current number.
    Excluded(u32),
}

impl<T: Numbered> Conditional<T> {
    /// The condition of a write.
    ///
    /// # Errors
    /// `precondition_failed` when it does not hold now; when the store cannot be read.
    pub async fn precondition(&self, app: &App) -> ApiResult<Precondition> {
        if let Some(condition) = self.unread() {
            return Ok(condition);
        }
        let current = self.of.current(app).await?;
        match self.holds(current) {
            Holds::Yes(condition) => Ok(condition),
            Holds::NotMatched => Err(self.failed(current)),
            Holds::Excluded(number) => {
                let detail = format!(
                    "nothing was changed: the current version is {number}, which If-None-Match excludes; omit that header to \
                     change it"
                );
                Err(ApiError::new(Code::PreconditionFailed, detail))
            }
        }
    }

    /// The error for a condition that does not hold. `current`: the current number.
    pub fn failed(&self, current: Option<u32>) -> ApiError {
        let (subject, kind) = (self.of.subject(), T::KIND);
        let header = if self.wanted.is_some() { header::IF_MATCH } else { header::IF_NONE_MATCH };
        let now = match current {
            Some(number) => format!("is at {} {number}", T::NUMBER),
            None => "does not exist".to_owned(),
        };
        let is_weak = |tags: &Tags| current.is_some_and(|number| tags.contains(&number.to_string()));
        let advice = match self.wanted.as_ref().is_some_and(is_weak) {
            // RFC 9110, section 13.1.1, wants a strong comparison
            true => {
                "its ETag is weak (W/) because a proxy compressed it on the way: send the ETag without W/".to_owned()
            }
            false => format!("read the {kind} again and retry"),
        };
        let detail = format!("{subject} {now}, which does not satisfy {header}; {advice}");
        ApiError::new(Code::PreconditionFailed, detail)
    }

    /// The response to a read, with the `ETag` of the number; 304 when the copy of the client is current.
    pub fn shown(&self, number: u32, document: &impl Serialize) -> Response {
        match &self.excluded {
            Some(tags) if tags.contains(&number.to_string()) => {
                (StatusCode::NOT_MODIFIED, revalidated(number)).into_response()
            }
            _ => shown(number, document),
        }
    }

    /// The response to a write, with the `ETag` of the number: 201 with `Location` if it created the resource,
    /// otherwise 200.
    pub fn written(&self, is_new: bool, number: u32, document: &impl Serialize) -> Response {
        let document = ([(header::ETAG, etag(&number.to_string()))], Json(document));
        match is_new {
            true => (StatusCode::CREATED, [(header::LOCATION, self.of.url())], document).into_response(),
            false => document.into_response(),
        }
    }
}

/// The response to a read that is never "not modified", with the `ETag` of the number.
pub fn shown(number: u32, document: &impl Serialize) -> Response {
    (revalidated(number), Json(document)).into_response()
}

/// The tag of a number, and that the client must ask again before it uses its copy.
fn revalidated(number: u32) -> [(HeaderName, HeaderValue); 2] {
    [(header::ETAG, etag(&number.to_string())), (header::CACHE_CONTROL, HeaderValue::from_static("no-cache"))]
}

/// The header value of a strong tag.
pub fn etag(opaque: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("\"{opaque}\"")).unwrap_or_else(|_| HeaderValue::from_static("\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn condition(headers: &[(HeaderName, &'static str)], current: Option<u32>) -> Option<Precondition> {
        let headers = headers.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value)));
        let conditional = Conditional::new((), &headers.collect());
        conditional.unread().or_else(|| match conditional.holds(current) {
            Holds::Yes(condition) => Some(condition),
            Holds::NotMatched | Holds::Excluded(_) => None,
        })
    }

    #[test]
    fn the_condition_of_a_write_follows_from_both_headers() {
        use Precondition::{Absent, Any, Present, Revision};
        let (only, none) = (header::IF_MATCH, header::IF_NONE_MATCH);
        for (headers, current, expected) in [
            (vec![], Some(4), Some(Any)),
            (vec![(&only, "*")], Some(4), Some(Present)),
            (vec![(&only, "\"3\", \"4\"")], Some(4), Some(Revision(4))),
            (vec![(&only, "W/\"4\"")], Some(4), None),
            (vec![(&only, "\"4\"")], None, None),
            (vec![(&none, "*")], Some(4), Some(Absent)),
            (vec![(&none, "\"4\"")], Some(4), None),
            (vec![(&none, "W/\"4\"")], Some(4), None),
            (vec![(&none, "\"3\"")], Some(4), Some(Revision(4))),
            (vec![(&none, "\"3\"")], None, Some(Absent)),
            (vec![(&only, "\"4\""), (&none, "\"3\"")], Some(4), Some(Revision(4))),
            (vec![(&only, "\"3\""), (&none, "*")], Some(4), None),
            (vec![(&only, "\"4\""), (&none, "*")], Some(4), None),
            (vec![(&only, "*"), (&none, "\"4\"")], Some(4), None),
            (vec![(&only, "*"), (&none, "*")], None, None),
        ] {
            let sent: Vec<_> = headers.into_iter().map(|(name, value)| (name.clone(), value)).collect();
            assert_eq!(condition(&sent, current), expected, "{sent:?}");
        }
    }
}
