//! A contact sheet: a page of pictures with captions, each a link to a file.

use maud::{DOCTYPE, PreEscaped, html};

/// A checkerboard is what transparent pixels show.
const STYLE: &str = "body{font:14px sans-serif;margin:16px;display:grid;gap:16px;\
    grid-template-columns:repeat(auto-fill,minmax(380px,1fr))}figure{margin:0}\
    img{width:100%;background:repeating-conic-gradient(#ddd 0 25%,#fff 0 50%) 0/16px 16px}";

/// A picture of the sheet.
#[derive(Debug)]
pub(super) struct Cell {
    /// The file that it links to, relative to the page.
    pub file: String,
    /// The picture that is shown.
    pub picture: String,
    /// What it is.
    pub caption: String,
}

/// The page.
pub(super) fn page(title: &str, cells: &[Cell]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head { meta charset="utf-8"; title { (title) } style { (PreEscaped(STYLE)) } }
            body {
                @for cell in cells {
                    figure { a href=(cell.file) { img src=(cell.picture) alt=(cell.caption); } figcaption { (cell.caption) } }
                }
            }
        }
    };
    page.into_string()
}
