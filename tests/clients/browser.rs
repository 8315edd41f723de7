//! The documentation page in a browser.

use std::process::Command;

use crate::{run, server::Server};

#[test]
#[ignore = "needs chromium"]
fn the_docs_page_renders_without_external_resources() {
    let server = Server::start();
    let profile = server.folder.path().join("browser");
    let page = run(Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        // Every name but this server's leads nowhere: a page that needs another one stays empty.
        .args(["--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--virtual-time-budget=20000"])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(["--dump-dom", &format!("{}/docs/", server.url)]));
    assert!(page.contains("/v1/stacks"), "the operations are listed: {page}");
    assert!(!page.contains("src=\"http") && !page.contains("href=\"https://fonts"), "something comes from outside");
}
