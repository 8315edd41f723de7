//! Markdown to HTML, with the anchors and links that a Markdown viewer of a repository would give it.

use std::collections::HashMap;

use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html::push_html};

/// A page.
#[derive(Debug)]
pub(super) struct Rendered {
    /// Its first heading.
    pub(super) title: String,
    /// The other headings, in order.
    pub(super) headings: Vec<Heading>,
    /// All after the first heading.
    pub(super) html: String,
}

/// A heading within a page.
#[derive(Debug)]
pub(super) struct Heading {
    /// Its anchor.
    pub(super) id: String,
    /// Its words.
    pub(super) text: String,
}

/// Renders the Markdown file at `path` of the project. `url_of` says where a file of the project is served; a link to
/// one that is not served becomes plain text.
pub(super) fn render(markdown: &str, path: &str, url_of: impl Fn(&str) -> Option<String>) -> Rendered {
    let mut page = Rendered { title: String::new(), headings: Vec::new(), html: String::new() };
    let mut used: HashMap<String, usize> = HashMap::new();
    let mut written = Vec::new();
    let mut events = Parser::new_ext(markdown, Options::ENABLE_TABLES).peekable();
    // links that are open, and whether each is written
    let mut links = Vec::new();
    while let Some(event) = events.next() {
        match event {
            Event::Start(Tag::Heading { level, .. }) => {
                let inner: Vec<_> =
                    events.by_ref().take_while(|e| !matches!(e, Event::End(TagEnd::Heading(_)))).collect();
                let text = words(&inner);
                if level == HeadingLevel::H1 && page.title.is_empty() {
                    page.title = text;
                    continue;
                }
                let id = anchor(&text, &mut used);
                let tag = Tag::Heading { level, id: Some(id.clone().into()), classes: Vec::new(), attrs: Vec::new() };
                written.push(Event::Start(tag));
                written.extend(inner);
                written.push(Event::End(TagEnd::Heading(level)));
                page.headings.push(Heading { id, text });
            }
            Event::Start(Tag::Link { link_type, dest_url, title, id }) => {
                let target = resolve(&dest_url, path, &url_of);
                links.push(target.is_some());
                if let Some(target) = target {
                    written.push(Event::Start(Tag::Link { link_type, dest_url: target.into(), title, id }));
                }
            }
            Event::End(TagEnd::Link) if links.pop() == Some(false) => {}
            Event::Start(Tag::Image { link_type, dest_url, title, id }) => {
                let dest_url = resolve(&dest_url, path, &url_of).map_or(dest_url, CowStr::from);
                written.push(Event::Start(Tag::Image { link_type, dest_url, title, id }));
            }
            // alignment would be an inline style, which the content policy forbids
            Event::Start(Tag::Table(columns)) => {
                // what scrolls must be reachable with the keyboard
                written.push(Event::Html("<div class=\"wide\" tabindex=\"0\">".into()));
                written.push(Event::Start(Tag::Table(vec![pulldown_cmark::Alignment::None; columns.len()])));
            }
            Event::End(TagEnd::Table) => {
                written.push(Event::End(TagEnd::Table));
                written.push(Event::Html("</div>".into()));
            }
            Event::Start(Tag::CodeBlock(_)) => written.push(Event::Html("<pre tabindex=\"0\"><code>".into())),
            Event::End(TagEnd::CodeBlock) => written.push(Event::Html("</code></pre>".into())),
            other => written.push(other),
        }
    }
    push_html(&mut page.html, written.into_iter());
    page
}

/// The words of a piece of text, without its marks.
fn words(events: &[Event<'_>]) -> String {
    events
        .iter()
        .filter_map(|event| match event {
            Event::Text(text) | Event::Code(text) => Some(text.as_ref()),
            Event::SoftBreak => Some(" "),
            _ => None,
        })
        .collect()
}

/// The anchor of a heading: lower case, blanks as dashes, without punctuation; numbered when it is there already.
fn anchor(text: &str, used: &mut HashMap<String, usize>) -> String {
    let kept = text.to_lowercase().replace(' ', "-");
    let kept: String = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect();
    let count = used.entry(kept.clone()).or_default();
    *count += 1;
    if *count == 1 { kept } else { format!("{kept}-{}", *count - 1) }
}

/// The URL of a link in the file at `from`; `None` if the guide does not have what it names.
fn resolve(link: &str, from: &str, url_of: &impl Fn(&str) -> Option<String>) -> Option<String> {
    if link.starts_with('#') || link.contains("://") {
        return Some(link.to_owned());
    }
    let (file, anchor) = link.split_once('#').map_or((link, None), |(file, anchor)| (file, Some(anchor)));
    let mut path: Vec<&str> = from.split('/').collect();
    path.pop();
    for part in file.split('/') {
        match part {
            "." => {}
            ".." => drop(path.pop()),
            part => path.push(part),
        }
    }
    let url = url_of(&path.join("/"))?;
    Some(anchor.map_or_else(|| url.clone(), |anchor| format!("{url}#{anchor}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(markdown: &str) -> Rendered {
        render(markdown, "docs/A.md", |path| {
            path.strip_prefix("docs/").and_then(|file| file.strip_suffix(".md")).map(|name| format!("/guide/{name}"))
        })
    }

    #[test]
    fn headings_have_the_anchors_of_a_repository() {
        let page = page("# A *title*\n\n## Run `it`, now\n\n### a_b\n\n## Run it now\n\n## Ünit/mm\n");
        let ids: Vec<_> = page.headings.iter().map(|heading| heading.id.as_str()).collect();
        assert_eq!((page.title.as_str(), ids), ("A title", vec!["run-it-now", "a_b", "run-it-now-1", "ünitmm"]));
        assert!(page.html.contains("<h2 id=\"run-it-now\">Run <code>it</code>, now</h2>"), "{}", page.html);
    }

    #[test]
    fn links_lead_into_the_guide_or_are_plain_text() {
        let html = page("[a](B.md#c) [b](../docs/./D.md) [c](../src/lib.rs) [d](#e) [e](https://x.org/)").html;
        let wanted = "<p><a href=\"/guide/B#c\">a</a> <a href=\"/guide/D\">b</a> c <a href=\"#e\">d</a> \
                      <a href=\"https://x.org/\">e</a></p>\n";
        assert_eq!(html, wanted);
    }

    #[test]
    fn nothing_has_an_inline_style_and_what_scrolls_takes_the_focus() {
        let html = page("| a | b |\n|---:|---|\n| 1 | 2 |\n\n```sh\na < b\n```\n").html;
        assert!(!html.contains("style="), "{html}");
        assert!(html.contains("<div class=\"wide\" tabindex=\"0\"><table>"), "{html}");
        assert!(html.contains("<pre tabindex=\"0\"><code>a &lt; b\n</code></pre>"), "{html}");
    }
}
