//! Callers and their rights: which token sent a request ([`identify`]), and which scopes the request needs ([`needs`]).

use std::convert::Infallible;

use axum::{
    extract::FromRequestParts,
    http::{Method, header, request::Parts},
};
use percent_encoding::percent_decode_str;
use uuid::Uuid;

use super::{ApiError, ApiResult, App, session};
use crate::{
    contract::{Code, Name},
    store::tokens::{Scope, Token, names, parse},
};

/// The caller of a request: its token, or none where the service requires none.
#[derive(Debug, Clone, Default)]
pub struct Caller(Option<Token>);

impl Caller {
    /// Id of the token; `None` where no token is required.
    pub fn id(&self) -> Option<Uuid> {
        self.0.as_ref().map(|token| token.id)
    }

    /// The token that made something, as a caller. `None` where tokens see only their own things, and this is of none.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub async fn of_owner(app: &App, owner: Option<Uuid>) -> ApiResult<Option<Self>> {
        match owner {
            Some(id) => Ok(app.store.metadata.token(id).await?.map(|token| Self(Some(token)))),
            None => Ok(Some(Self(None)).filter(|_| !app.policy.isolate_tokens)),
        }
    }

    /// The name of the token.
    pub fn name(&self) -> Option<&Name> {
        self.0.as_ref().map(|token| &token.name)
    }

    /// The token; `None` where no token is required.
    pub fn token(&self) -> Option<&Token> {
        self.0.as_ref()
    }

    /// The token whose stacks and uploads the caller may see; `None`: those of all tokens.
    pub fn sees_only(&self, app: &App) -> Option<Uuid> {
        let token = self.0.as_ref().filter(|token| app.policy.isolate_tokens && !token.allows(&[]))?;
        Some(token.id)
    }

    /// Requires one of these scopes.
    ///
    /// # Errors
    /// `forbidden`, with the scopes of the token and those that are needed.
    pub fn require(&self, any_of: &[Scope]) -> ApiResult<()> {
        match &self.0 {
            Some(token) if !token.allows(any_of) => {
                let detail = format!(
                    "the token '{}' has the scopes: {}; this request needs: {}",
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

/// Identifies the caller by its token: that of the header `Authorization`, or without one that of the cookie of the
/// web pages ([`session`]).
///
/// # Errors
/// `unauthorized`, with the same sentence whatever is wrong with the token: it must not reveal which tokens exist;
/// `cross_origin_request` when a page of another origin uses the cookie for a change.
pub async fn identify(app: &App, request: &Parts) -> ApiResult<Caller> {
    if !app.requires_token().await? {
        return Ok(Caller::default());
    }
    if !request.headers.contains_key(header::AUTHORIZATION)
        && let Some(text) = session::token(&request.headers)
    {
        session::require_own_page(request)?;
        return by_text(app, &text).await;
    }
    let headers = &request.headers;
    let text = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok()).ok_or_else(refused)?;
    let (kind, text) = text.split_once(' ').ok_or_else(refused)?;
    if !kind.eq_ignore_ascii_case("bearer") {
        return Err(refused());
    }
    by_text(app, text.trim()).await
}

/// The caller with this token.
///
/// # Errors
/// `unauthorized`.
pub async fn by_text(app: &App, text: &str) -> ApiResult<Caller> {
    let (id, secret) = parse(text).ok_or_else(refused)?;
    let token = app.store.metadata.token(id).await?.filter(|token| token.is_opened_by(&secret)).ok_or_else(refused)?;
    Ok(Caller(Some(token)))
}

fn refused() -> ApiError {
    let detail = "this service requires a token: send 'Authorization: Bearer <token>' with a token made by \
                  'pinstack token add' that is not revoked";
    ApiError::new(Code::Unauthorized, detail)
}
/// The scopes of which a request needs one; `None`: no token is needed. First match wins:
///
/// | request | scopes |
/// |---|---|
/// | `OPTIONS` anything; health, `/docs`, `/problems`, `/openapi.json` | no token |
/// | `/sign-in`, `/sign-out`, `/guide`, `/web` (style sheet and scripts of the pages) | no token |
/// | `GET /v1/uploads` (the uploads of all tokens) | `admin` |
/// | `GET /v1/uploads/...` | `read`, `stacks:write` or `profiles:write` |
/// | other requests below `/v1/uploads` | `stacks:write` or `profiles:write`; the purpose decides at the creation |
/// | other `GET` and `HEAD` | `read` |
/// | below `/v1/profiles` and `/v1/calibrations` | `profiles:write` |
/// | `POST /v1/poses`, `POST /v1/scans/{scan}/poses` (nothing is stored) | `read` |
/// | `POST /v1/groupings` (nothing is stored) | `read` or `stacks:write` |
/// | below `/v1/stacks`, `/v1/scans` and `/v1/reconstructions` | `stacks:write` |
/// | everything else | `admin` |
///
/// The table goes by prefix and denies by default: a new route below `/v1/stacks` is protected before anyone thinks of
/// it, and a route elsewhere needs `admin` until it gets a row. The OpenAPI document lists the result per operation as
/// `x-required-scopes`.
pub fn needs(method: &Method, path: &str) -> Option<&'static [Scope]> {
    let below = |place: &str| path.strip_prefix(place).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    let is_open = ["/sign-in", "/sign-out", "/favicon.ico", "/healthz", "/readyz", "/openapi.json"].contains(&path)
        || ["/docs", "/guide", "/problems", "/web"].into_iter().any(below);
    if is_open || *method == Method::OPTIONS {
        return None;
    }
    let reads = [Method::GET, Method::HEAD].contains(method);
    Some(if path == "/v1/uploads" && reads {
        &[Scope::Admin]
    } else if below("/v1/uploads") {
        match *method {
            Method::GET => &[Scope::Read, Scope::StacksWrite, Scope::ProfilesWrite],
            _ => &[Scope::StacksWrite, Scope::ProfilesWrite],
        }
    } else if reads {
        &[Scope::Read]
    } else if below("/v1/profiles") || below("/v1/calibrations") {
        &[Scope::ProfilesWrite]
    } else if *method == Method::POST && reports_poses(path) {
        &[Scope::Read]
    } else if *method == Method::POST && path == "/v1/groupings" {
        &[Scope::Read, Scope::StacksWrite]
    } else if below("/v1/stacks") || below("/v1/scans") || below("/v1/reconstructions") {
        &[Scope::StacksWrite]
    } else {
        &[Scope::Admin]
    })
}

/// True for the calls that only report on poses. A scan may itself be named `poses`.
fn reports_poses(path: &str) -> bool {
    let of_scan = |rest: &str| rest.split_once('/').is_some_and(|(_, call)| call == "poses");
    path == "/v1/poses" || path.strip_prefix("/v1/scans/").is_some_and(of_scan)
}

/// The id of the stack, reconstruction or upload in a path. With `isolate_tokens`, only its owner finds it.
pub fn owned_id(path: &str) -> Option<Uuid> {
    let places = ["/v1/stacks/", "/v1/reconstructions/", "/v1/uploads/", "/stacks/"];
    let rest = places.into_iter().find_map(|place| path.strip_prefix(place))?;
    // decoded, because handlers get the decoded id
    let id = percent_decode_str(rest.split('/').next()?).decode_utf8().ok()?;
    Uuid::parse_str(&id).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_owned_id_is_found_in_every_spelling() {
        let id = Uuid::now_v7();
        let encoded: String = id.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect();
        for written in [id.to_string(), id.simple().to_string(), id.to_string().to_uppercase(), encoded] {
            for path in [
                "/v1/stacks/{}",
                "/v1/uploads/{}/x",
                "/v1/reconstructions/{}/points",
                "/stacks/{}",
                "/stacks/{}/tiles/image/0/0/0",
            ] {
                let path = path.replace("{}", &written);
                assert_eq!(owned_id(&path), Some(id), "{path}");
            }
        }
    }

    #[test]
    fn each_request_needs_its_scope_and_unknown_requests_need_admin() {
        for (method, path, scopes) in [
            (Method::GET, "/healthz", None),
            (Method::GET, "/docs/index.html", None),
            (Method::GET, "/", Some("read")),
            (Method::GET, "/stacks/x/tiles/image/0/0/0", Some("read")),
            (Method::GET, "/sign-in", None),
            (Method::POST, "/sign-in", None),
            (Method::POST, "/sign-out", None),
            (Method::GET, "/web/0/app.css", None),
            (Method::POST, "/stacks/x", Some("admin")),
            (Method::GET, "/problems/forbidden", None),
            (Method::OPTIONS, "/v1/uploads", None),
            (Method::GET, "/docsother", Some("read")),
            (Method::GET, "/metrics", Some("read")),
            (Method::GET, "/v1/stacks/x/image", Some("read")),
            (Method::POST, "/v1/stacks", Some("stacks:write")),
            (Method::DELETE, "/v1/stacks/x", Some("stacks:write")),
            (Method::PUT, "/v1/scans/bee", Some("stacks:write")),
            (Method::POST, "/v1/scans/bee/archive", Some("stacks:write")),
            (Method::POST, "/v1/scans/bee/reconstructions", Some("stacks:write")),
            (Method::POST, "/v1/reconstructions/x/cancel", Some("stacks:write")),
            (Method::GET, "/v1/reconstructions/x/points", Some("read")),
            (Method::POST, "/v1/poses", Some("read")),
            (Method::POST, "/v1/scans/bee/poses", Some("read")),
            (Method::POST, "/v1/groupings", Some("read stacks:write")),
            (Method::PUT, "/v1/scans/poses", Some("stacks:write")),
            (Method::DELETE, "/v1/scans/poses", Some("stacks:write")),
            (Method::POST, "/v1/scans/poses/rerun", Some("stacks:write")),
            (Method::GET, "/v1/scans/bee/bundle", Some("read")),
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
