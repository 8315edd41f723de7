//! The guide: every page, link and anchor of it, without a token.

use std::collections::HashMap;

use reqwest::StatusCode;

use crate::app::TestApp;

/// The values of an attribute in a page.
fn values<'a>(page: &'a str, attribute: &str) -> Vec<&'a str> {
    page.split(&format!("{attribute}=\"")).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

/// All of the guide that links and pictures reach from its first page, by URL. Pictures have no text.
async fn whole(app: &TestApp) -> HashMap<String, String> {
    let (mut open, mut seen) = (vec!["/guide".to_owned()], HashMap::new());
    while let Some(path) = open.pop() {
        if seen.contains_key(&path) {
            continue;
        }
        let answer = app.get(&path).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        let is_page = answer.headers()["content-type"] == "text/html; charset=utf-8";
        let page = if is_page { answer.text().await.unwrap() } else { String::new() };
        for link in values(&page, "href").into_iter().chain(values(&page, "src")) {
            let file = link.split('#').next().unwrap_or_default();
            if file.starts_with("/guide") {
                open.push(file.to_owned());
            }
        }
        seen.insert(path, page);
    }
    seen
}

#[tokio::test]
async fn every_link_of_the_guide_leads_somewhere() {
    // the service asks for tokens, but not for the guide
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    assert_eq!(app.get("/v1/stacks").send().await.unwrap().status(), StatusCode::UNAUTHORIZED);
    let guide = whole(&app).await;
    assert!(guide.len() > 15, "{:?}", guide.keys());
    for (path, page) in &guide {
        assert!(!page.contains(" style=") && !page.contains("<script>"), "{path} has what its policy forbids");
        for link in values(page, "href").into_iter().filter(|link| !link.contains("://")) {
            let Some((file, anchor)) = link.split_once('#') else { continue };
            let target = if file.is_empty() { page } else { &guide[file] };
            assert!(target.contains(&format!("id=\"{anchor}\"")), "{path} links to {link}");
        }
    }
}

#[tokio::test]
async fn a_page_that_is_not_in_the_guide_is_refused_and_a_file_name_leads_to_its_page() {
    let app = TestApp::start().await;
    for path in ["/guide/NOTHING", "/guide/..%2FCargo.toml", "/guide/..%2F..%2Fx.png", "/guide/quality/none.jpg"] {
        assert_eq!(app.get(path).send().await.unwrap().status(), StatusCode::NOT_FOUND, "{path}");
    }
    let answer = app.get("/guide/SCANS.md").send().await.unwrap();
    assert_eq!((answer.status(), answer.url().path()), (StatusCode::OK, "/guide/SCANS"));
}
