//! `/sign-in` and `/sign-out`: the form that takes a token, and the cookie that keeps it.

use axum::{
    body::{Body, to_bytes},
    extract::{Request, State},
    http::{HeaderValue, StatusCode, Uri, header, request::Parts},
    response::{IntoResponse, Redirect, Response},
};
use maud::{Markup, html};

use super::{
    errors::ShownAsPage,
    frame::{Frame, Place},
    words::sentence,
};
use crate::{
    contract::Code,
    http::{ApiError, ApiResult, App, auth::by_text, extract::params, session},
};

/// Largest form, bytes.
const MAX_FORM: usize = 16 << 10;

/// The form.
///
/// # Errors
/// `invalid_request` for a damaged URL.
pub async fn form(State(app): State<App>, uri: Uri) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let next = destination(params::take(&mut pairs, "next").as_deref());
    if !app.requires_token().await? {
        return Ok(Redirect::to(&link!("{next}")).into_response());
    }
    Ok(shown(&next, None))
}

/// Signs in: checks the token, and answers with the cookie.
///
/// # Errors
/// `cross_origin_request` for a form of another site; `invalid_request`.
pub async fn sign_in(State(app): State<App>, request: Request) -> ApiResult<Response> {
    let (parts, body) = request.into_parts();
    session::require_own_page(&parts)?;
    let mut fields = fields(body).await?;
    let next = destination(params::take(&mut fields, "next").as_deref());
    let token = params::take(&mut fields, "token").unwrap_or_default();
    let token = token.trim();
    if by_text(&app, token).await.is_err() {
        let mut response = shown(&next, Some("this is not a token of this service, or it was revoked"));
        *response.status_mut() = StatusCode::FORBIDDEN;
        response.extensions_mut().insert(ShownAsPage);
        return Ok(response);
    }
    Ok(with_cookies(&parts, token, &next))
}

/// Signs out: removes the cookie.
///
/// # Errors
/// `cross_origin_request` for a form of another site.
pub async fn sign_out(request: Request) -> ApiResult<Response> {
    let (parts, _) = request.into_parts();
    session::require_own_page(&parts)?;
    Ok(with_cookies(&parts, "", "/sign-in"))
}

fn with_cookies(request: &Parts, token: &str, next: &str) -> Response {
    let mut response = Redirect::to(&link!("{next}")).into_response();
    for cookie in session::cookies(request, token) {
        response.headers_mut().append(header::SET_COOKIE, cookie);
    }
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

async fn fields(body: Body) -> ApiResult<Vec<(String, String)>> {
    let refused = || ApiError::new(Code::InvalidRequest, "the form cannot be read; reload the page and try again");
    let body = to_bytes(body, MAX_FORM).await.map_err(|_| refused())?;
    let text = str::from_utf8(&body).map_err(|_| refused())?;
    // a form is written like the query of a URL
    let uri: Uri = ["/?", text].concat().parse().map_err(|_| refused())?;
    params::pairs(&uri)
}

/// Where to go after signing in: a path of this server.
fn destination(next: Option<&str>) -> String {
    let is_path = |next: &&str| {
        let second = next.chars().nth(1);
        next.starts_with('/') && !matches!(second, Some('/' | '\\')) && next.chars().all(|c| c.is_ascii_graphic())
    };
    next.filter(is_path).unwrap_or("/").to_owned()
}

fn shown(next: &str, error: Option<&str>) -> Response {
    let frame = Frame { title: "Sign in", place: Place::Elsewhere, user: None, script: None };
    frame.answer(content(next, error))
}

fn content(next: &str, error: Option<&str>) -> Markup {
    html! {
        form.narrow method="post" action=(link!("/sign-in")) {
            h1 { "Sign in" }
            p { "This service asks for an access token. The operator of the server makes one with "
                code { "pinstack token add" } "." }
            @if let Some(error) = error { p.error role="alert" id="token-error" { (sentence(error)) "." } }
            label for="token" { "Access token" }
            input id="token" name="token" type="password" autocomplete="current-password" required autofocus
                spellcheck="false" aria-describedby=[error.map(|_| "token-error")];
            input type="hidden" name="next" value=(next);
            button.main type="submit" { "Sign in" }
            p.soft { "The browser keeps the token until it is closed. " a href=(link!("/docs/")) { "Documentation of the API" } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_paths_of_this_server_are_destinations() {
        for (next, to) in [
            (Some("/scans/bee?x=1"), "/scans/bee?x=1"),
            (Some("//evil.example"), "/"),
            (Some("/\\evil.example"), "/"),
            (Some("https://evil.example"), "/"),
            (Some("/a\r\nset-cookie: x"), "/"),
            (None, "/"),
        ] {
            assert_eq!(destination(next), to, "{next:?}");
        }
    }
}
