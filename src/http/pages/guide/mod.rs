//! `/guide`: the Markdown files of `docs/` and the README, to read in the browser of a machine that has nothing else of
//! pinstack. The program has them embedded, so the guide is always that of the running version.

mod markdown;

use std::{collections::BTreeMap, sync::LazyLock};

use axum::{
    extract::Path,
    http::header,
    response::{IntoResponse, Redirect, Response},
};
use maud::{Markup, PreEscaped, html};
use rust_embed::RustEmbed;

use self::markdown::{Heading, Rendered};
use super::{
    frame::{Frame, PageUser, Place},
    words::text,
};
use crate::{
    contract::Code,
    http::{ApiError, ApiResult},
};

#[derive(RustEmbed)]
#[folder = "docs/"]
struct Docs;

/// The README of the project, the only page outside of `docs/`.
const README: &str = include_str!("../../../../README.md");
/// The page that explains each warning: a heading per code.
const WARNINGS: &str = "TROUBLESHOOTING";
/// Path of the first page, with which the links within the guide begin.
const GUIDE: &str = "/guide";
/// A page with more headings than this has a list of them at its top.
const FEW_HEADINGS: usize = 3;

/// Every page by its name in the URL, made at the first use. The first page has the empty name.
static PAGES: LazyLock<BTreeMap<String, Rendered>> = LazyLock::new(|| {
    let files = Docs::iter().filter_map(|file| {
        let markdown = String::from_utf8(Docs::get(&file)?.data.into_owned()).ok()?;
        Some((format!("docs/{file}"), markdown))
    });
    let files = files.chain([("README.md".to_owned(), README.to_owned())]);
    files.filter_map(|(path, markdown)| Some((name(&path)?, markdown::render(&markdown, &path, url)))).collect()
});

/// The name of the page that a Markdown file of the project becomes; `None` for files that are no page.
fn name(path: &str) -> Option<String> {
    match path {
        "README.md" => Some("README".to_owned()),
        "docs/README.md" => Some(String::new()),
        path => path.strip_prefix("docs/")?.strip_suffix(".md").map(str::to_owned),
    }
}

/// The path of a file of the project, at which [`shown`] finds it; `None` for files that the guide does not have.
fn url(path: &str) -> Option<String> {
    match name(path) {
        Some(name) if name.is_empty() => Some(GUIDE.to_owned()),
        Some(name) => Some(format!("{GUIDE}/{name}")),
        None => {
            path.strip_prefix("docs/").filter(|file| Docs::get(file).is_some()).map(|file| format!("{GUIDE}/{file}"))
        }
    }
}

/// Where the guide explains a warning or note of a stack; `None` if it does not.
pub fn explanation(code: &str) -> Option<String> {
    let is_there = PAGES.get(WARNINGS)?.headings.iter().any(|heading| heading.id == code);
    is_there.then(|| link!("/guide/{WARNINGS}#{code}"))
}

/// The first page, `docs/README.md`.
///
/// # Errors
/// `not_found`, for a program without it.
pub async fn start(user: PageUser) -> ApiResult<Response> {
    shown("", &user)
}

/// A page, or a picture of one.
///
/// # Errors
/// `not_found`.
pub async fn page(Path(name): Path<String>, user: PageUser) -> ApiResult<Response> {
    if let Some(page) = name.strip_suffix(".md").filter(|page| PAGES.contains_key(*page)) {
        return Ok(Redirect::permanent(&link!("/guide/{page}")).into_response());
    }
    match media_type(&name).and_then(|media_type| Some((media_type, Docs::get(&name)?))) {
        Some((media_type, file)) => Ok(([(header::CONTENT_TYPE, media_type)], file.data.into_owned()).into_response()),
        None => shown(&name, &user),
    }
}

fn media_type(name: &str) -> Option<&'static str> {
    match name.rsplit_once('.')?.1 {
        "png" => Some("image/png"),
        "jpg" => Some("image/jpeg"),
        _ => None,
    }
}

fn shown(name: &str, user: &PageUser) -> ApiResult<Response> {
    let missing = || ApiError::new(Code::NotFound, "the guide has no such page; its first page is /guide");
    let page = PAGES.get(name).ok_or_else(missing)?;
    // the pages are made once, for all clients; a quote within text is escaped
    let guide = link!("{GUIDE}");
    let html = page.html.replace(&format!("=\"{GUIDE}"), &format!("=\"{guide}"));
    let frame = Frame { title: &page.title, place: Place::Elsewhere, user: Some(user), script: None };
    Ok(frame.answer(html! {
        article.guide {
            @if !name.is_empty() { p.crumbs { a href=(link!("/guide")) { "Guide" } } }
            h1 { (text(&page.title)) }
            (contents(&page.headings))
            (PreEscaped(html))
        }
    }))
}

/// The list of what is on a page, closed at first.
fn contents(headings: &[Heading]) -> Markup {
    html! {
        @if headings.len() > FEW_HEADINGS {
            details {
                summary { "On this page" }
                ul { @for heading in headings { li { a href={ "#" (heading.id) } { (text(&heading.text)) } } } }
            }
        }
    }
}
