//! Who is asking, and what that allows. One table says what each request needs; a request that nobody thought of needs
//! `admin`.

use std::convert::Infallible;

use axum::{
    extract::FromRequestParts,
    http::{HeaderMap, Method, header, request::Parts},
};
use percent_encoding::percent_decode_str;
use uuid::Uuid;

use super::{
    problem::{ApiError, ApiResult},
    state::App,
};
use crate::{
    contract::{Code, Name},
    store::tokens::{Scope, Token, names, parse},
};

/// Who is asking.
#[derive(Debug, Clone, Default)]
pub struct Caller(Option<Token>);

impl Caller {
    /// The token; nobody, where nobody is asked.
    pub fn id(&self) -> Option<Uuid> {
        self.0.as_ref().map(|token| token.id)
    }

    /// The name of the token.
    pub fn name(&self) -> Option<&Name> {
        self.0.as_ref().map(|token| &token.name)
    }

    /// The token itself; `None` where nobody is asked.
    pub fn token(&self) -> Option<&Token> {
        self.0.as_ref()
    }

    /// The token whose stacks alone are shown; `None`: all are.
    pub fn sees_only(&self, app: &App) -> Option<Uuid> {
        let token = self.0.as_ref().filter(|token| app.policy.isolate_tokens && !token.allows(&[]))?;
        Some(token.id)
    }

    /// Refuses a caller that may do none of these.
    ///
    /// # Errors
    /// `forbidden` that names what the token allows and what is needed.
    pub fn require(&self, any_of: &[Scope]) -> ApiResult<()> {
        match &self.0 {
            Some(token) if !token.allows(any_of) => {
                let detail = format!(
                    "the token '{}' allows: {}; this request needs: {}",
                    token.name,
                    names(&token.scopes, ", "),
                    names(any_of, " or ")
                );
                Err(ApiError::new(Code::Forbidden, detail))
            }
            _ => Ok(()),
        }
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get::<Self>().cloned().unwrap_or_default())
    }
}

/// Finds out who is asking.
///
/// # Errors
/// `unauthorized`, with the same sentence whatever is wrong with the token.
pub async fn identify(app: &App, headers: &HeaderMap) -> ApiResult<Caller> {
    if !app.asks_for_tokens().await? {
        return Ok(Caller::default());
    }
    let refused = || {
        let detail = "this service asks for a token: send Authorization: Bearer <token>, with one that was made by \
                      'pinstack token add' and not revoked";
        ApiError::new(Code::Unauthorized, detail)
    };
    let text = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok()).ok_or_else(refused)?;
    let (kind, text) = text.split_once(' ').ok_or_else(refused)?;
    if !kind.eq_ignore_ascii_case("bearer") {
        return Err(refused());
    }
    let (id, secret) = parse(text.trim()).ok_or_else(refused)?;
    let token = app.rows.token(id).await?.filter(|token| token.is_opened_by(&secret)).ok_or_else(refused)?;
    Ok(Caller(Some(token)))
}

/// What a request needs: one of these scopes, or no token at all.
pub fn needs(method: &Method, path: &str) -> Option<&'static [Scope]> {
    let below = |place: &str| path.strip_prefix(place).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    let is_open = ["/", "/favicon.ico", "/healthz", "/readyz", "/openapi.json"].contains(&path)
        || below("/docs")
        || below("/problems");
    if is_open || *method == Method::OPTIONS {
        return None;
    }
    let reads = [Method::GET, Method::HEAD].contains(method);
    Some(if path == "/v1/uploads" && reads {
        // those of all tokens
        &[Scope::Admin]
    } else if below("/v1/uploads") {
        // what it is for says which of the two, when it begins
        match *method {
            Method::GET => &[Scope::Read, Scope::StacksWrite, Scope::ProfilesWrite],
            _ => &[Scope::StacksWrite, Scope::ProfilesWrite],
        }
    } else if reads {
        &[Scope::Read]
    } else if below("/v1/profiles") || below("/v1/calibrations") {
        &[Scope::ProfilesWrite]
    } else if below("/v1/stacks") {
        &[Scope::StacksWrite]
    } else {
        &[Scope::Admin]
    })
}

/// The stack or upload that a path is about: where tokens see only their own, others' are not to be found.
pub fn owned_by_someone(path: &str) -> Option<Uuid> {
    let rest = path.strip_prefix("/v1/stacks/").or_else(|| path.strip_prefix("/v1/uploads/"))?;
    // handlers get the id decoded, so it must be looked at decoded here
    let id = percent_decode_str(rest.split('/').next()?).decode_utf8().ok()?;
    Uuid::parse_str(&id).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_owner_is_asked_for_however_the_id_is_written() {
        let id = Uuid::now_v7();
        let encoded: String = id.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect();
        for written in [id.to_string(), id.simple().to_string(), id.to_string().to_uppercase(), encoded] {
            for path in [format!("/v1/stacks/{written}"), format!("/v1/uploads/{written}/x")] {
                assert_eq!(owned_by_someone(&path), Some(id), "{path}");
            }
        }
    }

    #[test]
    fn each_request_needs_its_scope_and_an_unknown_one_admin() {
        for (method, path, scopes) in [
            (Method::GET, "/healthz", None),
            (Method::GET, "/docs/index.html", None),
            (Method::GET, "/", None),
            (Method::GET, "/problems/forbidden", None),
            (Method::OPTIONS, "/v1/uploads", None),
            (Method::GET, "/docsother", Some("read")),
            (Method::GET, "/metrics", Some("read")),
            (Method::GET, "/v1/stacks/x/image", Some("read")),
            (Method::POST, "/v1/stacks", Some("stacks:write")),
            (Method::DELETE, "/v1/stacks/x", Some("stacks:write")),
            (Method::PUT, "/v1/profiles/a/b", Some("profiles:write")),
            (Method::POST, "/v1/profiles/a/b/calibrations", Some("profiles:write")),
            (Method::POST, "/v1/calibrations/x/cancel", Some("profiles:write")),
            (Method::PATCH, "/v1/uploads/x", Some("stacks:write profiles:write")),
            (Method::HEAD, "/v1/uploads/x", Some("stacks:write profiles:write")),
            (Method::GET, "/v1/uploads/x", Some("read stacks:write profiles:write")),
            (Method::GET, "/v1/uploads", Some("admin")),
            (Method::HEAD, "/v1/uploads", Some("admin")),
            (Method::POST, "/v1/stacksother", Some("admin")),
            (Method::POST, "/v1/anything", Some("admin")),
        ] {
            assert_eq!(needs(&method, path).map(|s| names(s, " ")).as_deref(), scopes, "{method} {path}");
        }
    }
}
