//! The session of a person who uses the web pages: a cookie with the token.
//!
//! | property | why |
//! |---|---|
//! | `HttpOnly` | no script can read the token |
//! | `SameSite=Strict` | the browser does not send it with requests of other sites |
//! | `Secure`, and the prefix `__Host-` or `__Secure-`, over TLS | the token never travels in clear |
//! | `Path`: that of the service | no other service of the host gets it |
//! | no lifetime | it ends with the browser |
//!
//! Another service on the same machine is the same site for a browser. So a change by cookie must come from a page of
//! this origin, as `Sec-Fetch-Site` or `Origin` say ([`require_own_page`]). A request with the header `Authorization`
//! is judged by that header alone.

use std::sync::Arc;

use axum::http::{HeaderMap, HeaderValue, header, request::Parts};

use super::{
    ApiResult,
    connections::Seat,
    links,
    middleware::browser::{foreign_page, is_of_own_page},
};

/// Name of the cookie without TLS.
const PLAIN: &str = "pinstack_token";
/// Name of the cookie over TLS. Browsers accept this prefix only with `Secure`, and with no other domain or path.
const OF_HOST: &str = "__Host-pinstack_token";
/// The same below a sub-path, which other services share the host with.
const OF_PATH: &str = "__Secure-pinstack_token";

/// Marks requests on TLS connections of this server.
#[derive(Debug, Clone, Copy)]
pub struct OverTls;

/// Name of the cookie over TLS of a service at this sub-path.
fn secure(prefix: &str) -> &'static str {
    if prefix.is_empty() { OF_HOST } else { OF_PATH }
}

/// The token in the cookie of a request.
pub fn token(headers: &HeaderMap) -> Option<String> {
    let pairs = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let pairs: Vec<(&str, &str)> =
        pairs.flat_map(|list| list.split(';')).filter_map(|p| p.trim().split_once('=')).collect();
    let named = |name: &str| pairs.iter().find(|(found, _)| *found == name).map(|(_, value)| (*value).to_owned());
    named(secure(&links::prefix())).or_else(|| named(PLAIN)).filter(|token| !token.is_empty())
}

/// Checks that a change comes from one of the service's own pages. Reading needs no check.
///
/// # Errors
/// `cross_origin_request`.
pub fn require_own_page(request: &Parts) -> ApiResult<()> {
    if request.method.is_safe() || is_of_own_page(request) {
        return Ok(());
    }
    Err(foreign_page(request))
}

/// Whether the client uses TLS, to this server or to a trusted proxy in front of it.
fn is_secure(request: &Parts) -> bool {
    let behind = |seat: &Arc<Seat>| seat.is_behind_tls(&request.headers);
    request.extensions.get::<OverTls>().is_some() || request.extensions.get().is_some_and(behind)
}

/// The headers `Set-Cookie` that sign in with a token, or sign out with an empty one.
pub fn cookies(request: &Parts, token: &str) -> Vec<HeaderValue> {
    let prefix = links::prefix();
    let path = if prefix.is_empty() { "/" } else { &*prefix };
    let secure_name = secure(&prefix);
    let of = |name: &str, token: &str| {
        let secure = if name == secure_name { "; Secure" } else { "" };
        let age = if token.is_empty() { "; Max-Age=0" } else { "" };
        HeaderValue::from_str(&format!("{name}={token}; Path={path}; HttpOnly; SameSite=Strict{secure}{age}")).ok()
    };
    let cookies = match (is_secure(request), token.is_empty()) {
        (true, true) => vec![of(secure_name, ""), of(PLAIN, "")],
        (true, false) => vec![of(secure_name, token), of(PLAIN, "")],
        (false, _) => vec![of(PLAIN, token)],
    };
    cookies.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::{Method, Request};

    fn request(method: Method, headers: &[(&str, &str)]) -> Parts {
        let builder = headers.iter().fold(Request::builder().method(method).uri("/x"), |b, (n, v)| b.header(*n, *v));
        builder.body(()).expect("a request").into_parts().0
    }

    #[test]
    fn the_token_is_found_among_other_cookies() {
        for (cookies, found) in [
            ("a=b; pinstack_token=t; c=d", Some("t")),
            ("pinstack_token=t;__Host-pinstack_token=s", Some("s")),
            ("xpinstack_token=t", None),
            ("pinstack_token=", None),
            ("", None),
        ] {
            let parts = request(Method::GET, &[("cookie", cookies)]);
            assert_eq!(token(&parts.headers).as_deref(), found, "{cookies}");
        }
    }

    #[test]
    fn only_own_pages_may_change_things_by_cookie() {
        let (own, foreign) = (("origin", "http://lab:8080"), ("origin", "http://lab:9000"));
        let host = ("host", "lab:8080");
        for (headers, is_allowed) in [
            (vec![host, own], true),
            (vec![host, own, ("sec-fetch-site", "same-origin")], true),
            (vec![host, own, ("sec-fetch-site", "same-site")], false),
            (vec![host, own, ("sec-fetch-site", "none")], false),
            (vec![host, foreign], false),
            (vec![host, ("origin", "null")], false),
            (vec![host], false),
        ] {
            assert_eq!(require_own_page(&request(Method::POST, &headers)).is_ok(), is_allowed, "{headers:?}");
            assert!(require_own_page(&request(Method::GET, &headers)).is_ok());
        }
    }

    #[test]
    fn the_cookie_is_secure_over_tls() {
        let mut parts = request(Method::POST, &[]);
        assert_eq!(cookies(&parts, "t"), ["pinstack_token=t; Path=/; HttpOnly; SameSite=Strict"]);
        parts.extensions.insert(OverTls);
        assert_eq!(
            cookies(&parts, "t"),
            [
                "__Host-pinstack_token=t; Path=/; HttpOnly; SameSite=Strict; Secure",
                "pinstack_token=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0"
            ]
        );
    }
}
