//! Keeps web pages from using a service that requires no token.
//!
//! A browser in the lab can reach the service, and so can every page that it shows. Two kinds of requests are refused:
//!
//! | attack | sign | answer |
//! |---|---|---|
//! | DNS rebinding: the page's own host name resolves to the service | `Host` is a foreign name | 421 |
//! | cross-site request that changes something | `Origin` or `Sec-Fetch-Site` of another site | 403 |
//!
//! Cross-site reads need no check: the browser withholds the answer from the page ([`super::cors`]). Programs other
//! than browsers send neither `Origin` nor `Sec-Fetch-Site`. Where tokens are required, pages of other sites have none,
//! so only the syntax of `Host` is checked; [`crate::http::session`] guards the cookie of the service's own pages.

use std::net::IpAddr;

use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, Method, Version, header, request::Parts, uri::Authority},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, one_line},
    http::{ApiError, ApiResult, App, Policy, ingest::body::discard},
};

const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// The layer.
pub async fn check(State(app): State<App>, request: Request, next: Next) -> Response {
    let admitted = match host(&request).map(|host| require_own_page(&app.policy, &request, host)) {
        Ok(Err(refusal)) => unless_it_needs_a_token(&app, refusal).await,
        Ok(Ok(())) => Ok(()),
        Err(error) => Err(error),
    };
    match admitted {
        Ok(()) => next.run(request).await,
        Err(error) => {
            let (parts, body) = request.into_parts();
            discard(&parts.headers, body);
            error.into_response()
        }
    }
}

/// Tokens may be required since the first one was made. If that is unknown, the request stays refused.
async fn unless_it_needs_a_token(app: &App, refusal: ApiError) -> ApiResult<()> {
    match app.requires_token().await {
        Ok(true) => Ok(()),
        Ok(false) | Err(_) => Err(refusal),
    }
}

/// Refuses what a page of another site can make a browser send.
fn require_own_page(policy: &Policy, request: &Request, host: Option<Authority>) -> ApiResult<()> {
    if policy.auth_required {
        return Ok(());
    }
    // a host in the request target takes precedence over `Host` (RFC 9112, section 3.2.2)
    let named = request.uri().authority().cloned();
    if let Some(foreign) = [&host, &named].into_iter().flatten().find(|host| !is_own_name(policy, host.host())) {
        let detail = format!(
            "the request is for the host '{}', which is not a name of this service; use its address, or add the name to the \
             setting 'hosts' (PINSTACK_HOSTS); a proxy in between must pass on the header Host of the client",
            one_line(foreign.host())
        );
        return Err(ApiError::new(Code::MisdirectedRequest, detail));
    }
    require_own_origin(policy, request.method(), request.headers(), named.or(host).as_ref())
}

/// The `Host` of a request; `None` only for HTTP/1.0, where it is optional.
fn host(request: &Request) -> ApiResult<Option<Authority>> {
    let mut hosts = request.headers().get_all(header::HOST).iter();
    let refused = |detail: &str| Err(ApiError::new(Code::InvalidRequest, detail));
    match (hosts.next(), hosts.next()) {
        (None, _) if request.version() >= Version::HTTP_11 => refused("the request has no Host header; send one"),
        (None, _) => Ok(None),
        (Some(_), Some(_)) => refused("the request has more than one Host header; send one"),
        (Some(host), None) => match Authority::try_from(host.as_bytes()) {
            Ok(host) if !host.as_str().contains('@') => Ok(Some(host)),
            _ => refused("the Host header is not a host name or address with an optional port"),
        },
    }
}

/// True for `localhost`, the addresses that the service listens on, and the configured names. Addresses are safe: DNS
/// rebinding needs a name.
fn is_own_name(policy: &Policy, host: &str) -> bool {
    let name = host.strip_suffix('.').unwrap_or(host);
    if let Ok(address) = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
        let address = address.to_canonical();
        let is_listened_on = |listened: IpAddr| listened.is_unspecified() || listened.to_canonical() == address;
        return address.is_loopback() || policy.listen.is_some_and(is_listened_on);
    }
    name.eq_ignore_ascii_case("localhost") || policy.hosts.iter().any(|own| own.eq_ignore_ascii_case(name))
}

fn require_own_origin(
    policy: &Policy,
    method: &Method,
    headers: &HeaderMap,
    host: Option<&Authority>,
) -> ApiResult<()> {
    if method.is_safe() {
        return Ok(());
    }
    let origin = headers.get(header::ORIGIN).map(|origin| String::from_utf8_lossy(origin.as_bytes()));
    if origin.as_ref().is_some_and(|origin| policy.cors_origins.iter().any(|allowed| allowed == origin)) {
        return Ok(());
    }
    if !is_of_foreign_site(headers) && origin.as_ref().is_none_or(|origin| is_at(origin, host)) {
        return Ok(());
    }
    let detail = format!(
        "the request comes from {}; while the service requires no token, it accepts changes only from its own pages and from \
         programs that are not browsers; {}to allow an origin, add it to the setting 'cors_origins'",
        sender(origin.as_deref()),
        if_a_proxy_changed(headers, host)
    );
    Err(ApiError::new(Code::CrossOriginRequest, detail))
}

/// Whether an origin is that of the host of the request.
fn is_at(origin: &str, host: Option<&Authority>) -> bool {
    let place = origin.split_once("://").map(|(_, place)| place);
    place.zip(host).is_some_and(|(place, host)| place.eq_ignore_ascii_case(host.as_str()))
}

/// Whether a browser says that a page of another site sent the request.
fn is_of_foreign_site(headers: &HeaderMap) -> bool {
    headers.get(&SEC_FETCH_SITE).is_some_and(|site| !["same-origin", "none"].iter().any(|own| site == own))
}

/// What to do if the page is one of the service, and only looks foreign because a proxy changed `Host`. Empty if it
/// cannot be one.
fn if_a_proxy_changed(headers: &HeaderMap, host: Option<&Authority>) -> String {
    let may_be_own = headers.get(header::ORIGIN).is_some_and(|origin| origin != "null") && !is_of_foreign_site(headers);
    let Some(host) = host.filter(|_| may_be_own) else { return String::new() };
    format!(
        "if that is an address of this service, a proxy has changed the header Host to '{}': let the proxy pass on the \
         Host of the client (nginx: proxy_set_header Host $http_host; Apache: ProxyPreserveHost On); ",
        one_line(host.as_str())
    )
}

/// The refusal of a change that a page of another origin sent with the cookie of a person.
pub fn foreign_page(request: &Parts) -> ApiError {
    let origin = request.headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
    let detail = format!(
        "the request comes from {}; a browser that is signed in may change things only from the pages of this service; \
         {}other programs send the token in the header Authorization",
        sender(origin),
        if_a_proxy_changed(&request.headers, named_host(request).as_ref())
    );
    ApiError::new(Code::CrossOriginRequest, detail)
}

/// The host that a request names.
fn named_host(request: &Parts) -> Option<Authority> {
    let host = request.headers.get(header::HOST).and_then(|host| Authority::try_from(host.as_bytes()).ok());
    request.uri.authority().cloned().or(host)
}

/// Whether a browser says that one of the service's own pages sent the request: by `Sec-Fetch-Site`, or where the
/// connection is not secure and browsers omit that header, by `Origin`.
pub fn is_of_own_page(request: &Parts) -> bool {
    if let Some(site) = request.headers.get(&SEC_FETCH_SITE) {
        return site == "same-origin";
    }
    let origin = request.headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
    origin.is_some_and(|origin| is_at(origin, named_host(request).as_ref()))
}

/// The page that sent a request, for an error message.
fn sender(origin: Option<&str>) -> String {
    match origin {
        None => "a page of another site".to_owned(),
        Some("null") => "a page without an origin (Origin: null), such as a local file or a sandboxed frame".to_owned(),
        Some(origin) => {
            let origin: String = origin.chars().take(200).collect();
            format!("a page of the origin {}", one_line(&origin))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_host_names_are_localhost_listening_addresses_and_configured_names() {
        let listening = |listen: Option<&str>, hosts: &[&str]| Policy {
            listen: listen.map(|address| address.parse().expect("an address")),
            hosts: hosts.iter().map(|&host| host.to_owned()).collect(),
            ..Policy::default()
        };
        let here = listening(None, &[]);
        let lab = listening(Some("192.168.7.5"), &["lab-pc.example"]);
        let all = listening(Some("0.0.0.0"), &[]);
        for (policy, host, is_own) in [
            (&here, "localhost", true),
            (&here, "LocalHost.", true),
            (&here, "127.0.0.1", true),
            (&here, "127.9.9.9", true),
            (&here, "[::1]", true),
            (&here, "[::ffff:127.0.0.1]", true),
            (&here, "192.168.7.5", false),
            (&here, "evil.example", false),
            (&here, "localhost.evil.example", false),
            (&here, "127.0.0.1.evil.example", false),
            (&lab, "192.168.7.5", true),
            (&lab, "192.168.7.6", false),
            (&lab, "Lab-PC.example", true),
            (&lab, "evil.lab-pc.example", false),
            (&all, "10.1.2.3", true),
            (&all, "[fe80::1]", true),
            (&all, "pinstack", false),
        ] {
            assert_eq!(is_own_name(policy, host), is_own, "{host} {:?}", policy.listen);
        }
    }
}
