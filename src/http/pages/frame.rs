//! What all pages have in common: head, navigation, and the headers of the answer.

use std::convert::Infallible;

use axum::{
    extract::FromRequestParts,
    http::{HeaderValue, header, request::Parts},
    response::{IntoResponse, Response},
};
use maud::{DOCTYPE, Markup, html};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};

use super::{assets, words::text};
use crate::{
    http::{App, auth::Caller},
    store::tokens::Scope,
};

/// Scripts, styles, pictures and connections come from this server alone; nothing is written into the page itself.
/// `blob:` is for pictures that a script received.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// The person in front of the browser, and what the service allows them. Buttons that it would refuse are not shown.
#[derive(Debug, Clone, Default)]
pub struct PageUser {
    /// Name of the token; `None` where none is needed.
    pub name: Option<String>,
    /// May send, rerun, cancel and delete stacks and scans.
    pub stacks: bool,
    /// May calibrate, and write profiles.
    pub profiles: bool,
}

impl PageUser {
    /// The rights of a caller.
    pub fn of(caller: &Caller) -> Self {
        let may = |scope: Scope| caller.require(&[scope]).is_ok();
        Self {
            name: caller.name().map(ToString::to_string),
            stacks: may(Scope::StacksWrite),
            profiles: may(Scope::ProfilesWrite),
        }
    }
}

impl FromRequestParts<App> for PageUser {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Infallible> {
        Ok(Self::of(&Caller::from_request_parts(parts, app).await?))
    }
}

/// The places of the navigation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The page that opens first.
    Home,
    /// Stacks.
    Stacks,
    /// Sending.
    Send,
    /// Scans.
    Scans,
    /// Profiles and calibrations.
    Profiles,
    /// Planner and target.
    Plan,
    /// None of them.
    Elsewhere,
}

/// The frame of one page.
#[derive(Debug)]
pub struct Frame<'a> {
    /// Title.
    pub title: &'a str,
    /// Where it is in the navigation.
    pub place: Place,
    /// Who sees it; `None` for a page that anyone sees, which has no navigation.
    pub user: Option<&'a PageUser>,
    /// Module that runs on the page.
    pub script: Option<&'static str>,
}

impl Frame<'_> {
    /// The whole page with `content`.
    pub fn around(&self, content: Markup) -> Markup {
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (text(self.title)) " · pinstack" }
                    link rel="icon" type="image/svg+xml" href=(assets::url("icon.svg"));
                    link rel="stylesheet" href=(assets::url("app.css"));
                    @if let Some(script) = self.script {
                        script type="module" src=(assets::url(script)) {}
                    }
                }
                body {
                    a.skip href="#content" { "Skip to the content" }
                    header.top {
                        a.brand href=(link!("/")) { img src=(assets::url("icon.svg")) alt="" width="24" height="24"; "pinstack" }
                        @if let Some(user) = self.user {
                            (self.navigation(user))
                        }
                    }
                    main id="content" tabindex="-1" { (content) }
                    noscript { p.note { "This page needs JavaScript to send, change and follow stacks." } }
                }
            }
        }
    }

    fn navigation(&self, user: &PageUser) -> Markup {
        let places = [
            (Place::Home, link!("/"), "Home", true),
            (Place::Stacks, link!("/stacks"), "Stacks", true),
            (Place::Send, link!("/send"), "Send", user.stacks || user.profiles),
            (Place::Scans, link!("/scans"), "Scans", true),
            (Place::Profiles, link!("/profiles"), "Profiles", true),
            (Place::Plan, link!("/plan"), "Plan", true),
        ];
        html! {
            nav aria-label="Main" {
                @for (place, href, name, is_shown) in places {
                    @if is_shown {
                        a href=(href) aria-current=[(place == self.place).then_some("page")] { (name) }
                    }
                }
            }
            div.who {
                a href=(link!("/guide")) { "Guide" }
                a href=(link!("/docs/")) { "API" }
                @if let Some(name) = &user.name {
                    span title="The token with which you are signed in" { (text(name)) }
                    form method="post" action=(link!("/sign-out")) { button.quiet type="submit" { "Sign out" } }
                }
            }
        }
    }

    /// The answer with this page.
    pub fn answer(&self, content: Markup) -> Response {
        respond(self.around(content))
    }
}

/// The URL of a page with query parameters.
pub fn address<'a>(place: &str, parameters: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let query = parameters.map(|(name, value)| format!("{name}={}", utf8_percent_encode(value, NON_ALPHANUMERIC)));
    let query = query.collect::<Vec<_>>().join("&");
    if query.is_empty() { place.to_owned() } else { format!("{place}?{query}") }
}

/// The links below a list: to its first page, unless that is shown, and to the next one. `place` is the URL of the
/// list, `filters` its query parameters.
pub fn pager(place: &str, filters: &[(String, String)], is_first: bool, next: Option<&str>) -> Markup {
    let link = |cursor: Option<&str>| {
        let filters = filters.iter().map(|(name, value)| (name.as_str(), value.as_str()));
        address(place, filters.chain(cursor.map(|cursor| ("cursor", cursor))))
    };
    html! {
        div.pager {
            @if is_first { span {} } @else { a href=(link(None)) { "Newest" } }
            @if let Some(next) = next { a href=(link(Some(next))) rel="next" { "Older" } }
        }
    }
}

/// An answer with HTML. It is kept by no cache: it may show what only this person may see.
pub fn respond(markup: Markup) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        (header::CACHE_CONTROL, HeaderValue::from_static("private, no-store")),
        // with `no-referrer` a browser would send forms with `Origin: null`, like those of a foreign page
        (header::REFERRER_POLICY, HeaderValue::from_static("same-origin")),
    ];
    (headers, markup.into_string()).into_response()
}
