//! Cursors: a list takes those that it returned, and no others.

use pinstack::store::tokens::Scope;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::{
    access::token,
    app::{TestApp, id, problem, profile, stack_zip},
    uploads::client::{creation, of_rig},
};

/// Two rows in every list. The lists have the paths that are returned.
async fn two_of_each() -> (TestApp, Vec<&'static str>) {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_profile(3).await;
    app.put("/v1/profiles/rig/other").json(&profile(2)).send().await.unwrap();
    app.put("/v1/profiles/rig/other").json(&profile(3)).send().await.unwrap();
    for name in ["bee", "fly"] {
        app.with_scan(name).await;
        let stack = app.post("/v1/stacks?rig=rig&lens=other").body(stack_zip(3, 0)).send().await.unwrap();
        assert_eq!(stack.status(), StatusCode::ACCEPTED);
        let target = app.post("/v1/profiles/rig/lens/calibrations").body(stack_zip(2, 0)).send().await.unwrap();
        assert_eq!(target.status(), StatusCode::ACCEPTED);
        assert_eq!(creation(&app, 1000, &of_rig()).send().await.unwrap().status(), StatusCode::CREATED);
    }
    let revisions = ["/v1/profiles/rig/lens/revisions", "/v1/profiles/rig/other/revisions"];
    let lists = ["/v1/stacks", "/v1/calibrations", "/v1/scans", "/v1/profiles", "/v1/uploads"];
    (app, [&lists[..], &revisions].concat())
}

async fn page(app: &TestApp, list: &str, cursor: &str) -> Value {
    let answer = app.get(&format!("{list}?limit=1{cursor}")).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK, "{list} {cursor}");
    answer.json().await.unwrap()
}

#[tokio::test]
async fn a_list_takes_only_the_cursors_that_it_returned() {
    let (app, lists) = two_of_each().await;
    let mut cursors = Vec::new();
    for list in &lists {
        let first = page(&app, list, "").await;
        let cursor = first["next_cursor"].as_str().unwrap_or_else(|| panic!("{list} has two pages")).to_owned();
        let second = page(&app, list, &format!("&cursor={cursor}")).await;
        assert_eq!(second["items"].as_array().unwrap().len(), 1);
        assert_ne!(first["items"], second["items"], "{list}");
        assert_eq!(second["next_cursor"], Value::Null, "{list}");
        cursors.push(cursor);
    }
    for (at, list) in lists.iter().enumerate() {
        let own = &cursors[at];
        let spoilt =
            [format!("0{own}"), format!("%2B{own}"), format!("{own}0"), format!("%20{own}"), own.to_uppercase()];
        let made_up = ["", "xyz", "abc", "0abc", "ABC", "%2Babc", "1", "7fffffffffffffff", "0000000000000001"];
        let uuid = "01900000000070008000000000000000";
        let others = cursors.iter().filter(|other| *other != own).map(String::as_str);
        let wrong =
            spoilt.iter().map(String::as_str).filter(|text| text != own).chain(made_up).chain([uuid]).chain(others);
        for cursor in wrong {
            let answer = app.get(&format!("{list}?limit=1&cursor={cursor}")).send().await.unwrap();
            let told = problem(answer, 400, "invalid_request").await;
            assert!(
                told["detail"].as_str().unwrap().contains("invalid cursor for this list"),
                "{list} {cursor}: {told}"
            );
        }
    }
}

#[tokio::test]
async fn the_lists_of_the_pages_refuse_them_too() {
    let (app, _) = two_of_each().await;
    let scans = page(&app, "/v1/scans", "").await["next_cursor"].as_str().unwrap().to_owned();
    for path in ["/stacks", "/scans", "/profiles"] {
        for cursor in ["abc", "7fffffffffffffff", scans.as_str()] {
            let answer =
                app.get(&format!("{path}?cursor={cursor}")).header("accept", "text/html").send().await.unwrap();
            let is_own = path == "/scans" && cursor == scans;
            assert_eq!(answer.status() == StatusCode::OK, is_own, "{path} {cursor}: {}", answer.status());
        }
    }
}

#[tokio::test]
async fn a_cursor_stays_good_when_its_row_was_deleted() {
    let app = TestApp::start().await;
    let ids = [app.with_stack("").await, app.with_stack("").await, app.with_stack("").await].map(|stack| id(&stack));
    let first = page(&app, "/v1/stacks", "").await;
    assert_eq!(first["items"][0]["id"], json!(ids[2]));
    let deleted = app.delete(&format!("/v1/stacks/{}", ids[2])).send().await.unwrap();
    assert!(deleted.status().is_success());
    let next = page(&app, "/v1/stacks", &format!("&cursor={}", first["next_cursor"].as_str().unwrap())).await;
    assert_eq!(next["items"][0]["id"], json!(ids[1]));
    // a token and a filter make no other list
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    let cursor = next["next_cursor"].as_str().unwrap();
    let url = format!("/v1/stacks?rig=rig&limit=7&cursor={cursor}");
    let last: Value = app.get(&url).bearer_auth(admin).send().await.unwrap().json().await.unwrap();
    assert_eq!(last["items"][0]["id"], json!(ids[0]));
}
