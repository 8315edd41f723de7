//! Errors of pages as pages. The API and scripts get problem documents, as before.

use axum::{
    extract::Request,
    http::{HeaderMap, HeaderValue, Method, header},
    middleware::Next,
    response::{IntoResponse, Redirect, Response},
};
use maud::html;
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};

use super::{
    frame::{Frame, Place},
    words::sentence,
};
use crate::contract::{Code, Problem};

/// Marks an answer that shows its error as a page.
#[derive(Debug, Clone, Copy)]
pub struct ShownAsPage;

/// The first segments of the paths of pages.
const PAGES: [&str; 10] =
    ["", "stacks", "send", "scans", "profiles", "calibrations", "plan", "guide", "sign-in", "sign-out"];

/// The layer: a person who opens a page that needs a token comes to the page that asks for it, and from there back;
/// also one who follows a link of a page to the API, such as that of a report, when the session has ended. Other errors
/// of pages are shown in words.
pub async fn for_people(request: Request, next: Next) -> Response {
    let first = request.uri().path().trim_start_matches('/').split('/').next().unwrap_or_default();
    let is_page = PAGES.contains(&first);
    if !(is_page || is_opened(request.headers())) || !accepts_html(request.headers()) {
        return next.run(request).await;
    }
    let is_read = request.method() == Method::GET;
    let there = request.uri().path_and_query().map_or("/", |there| there.as_str()).to_owned();
    let response = next.run(request).await;
    let Some(problem) = response.extensions().get::<Problem>().cloned() else { return response };
    if problem.code == Code::Unauthorized && is_read {
        let next = utf8_percent_encode(&there, NON_ALPHANUMERIC);
        let mut redirect = Redirect::to(&link!("/sign-in?next={next}")).into_response();
        redirect.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        return redirect;
    }
    if is_page { page(&problem, &response) } else { response }
}

/// Whether a browser opens what it asks for as a document of its own.
fn is_opened(headers: &HeaderMap) -> bool {
    headers.get("sec-fetch-dest").is_some_and(|place| place == "document")
}

fn accepts_html(headers: &HeaderMap) -> bool {
    let accept = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok());
    accept.is_some_and(|accept| accept.contains("text/html"))
}

fn page(problem: &Problem, refused: &Response) -> Response {
    let frame = Frame { title: &problem.title, place: Place::Elsewhere, user: None, script: None };
    let mut response = frame.answer(html! {
        h1 { (problem.title) }
        p.lead { (sentence(&problem.detail)) "." }
        p { a href=(link!("/")) { "Go to the home page" } " · " a href=(link!("/sign-in")) { "Sign in with another token" } }
        p.soft { "Code: " code { (problem.code.name()) } }
    });
    *response.status_mut() = refused.status();
    for (name, value) in refused.headers() {
        if ![header::CONTENT_TYPE, header::CONTENT_LENGTH].contains(name) && !response.headers().contains_key(name) {
            response.headers_mut().append(name, value.clone());
        }
    }
    response.extensions_mut().insert(ShownAsPage);
    response
}
