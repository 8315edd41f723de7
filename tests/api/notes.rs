//! Notes about stacks, scans and profiles, over HTTP and on the pages.

use pinstack::store::tokens::Scope;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::{
    access::token,
    app::{TestApp, id, problem},
    pages::{HTML, checked, page},
};

const CREATED: StatusCode = StatusCode::CREATED;

/// The URLs of a stack, a scan and a profile, below `/v1` and as pages.
async fn subjects(app: &TestApp) -> [String; 3] {
    app.with_scan("bee").await;
    let stack = id(&app.with_stack("&scan=bee").await);
    [format!("/stacks/{stack}"), "/scans/bee".into(), "/profiles/rig/lens".into()]
}

async fn listed(app: &TestApp, url: &str) -> Vec<Value> {
    let list: Value = app.get(url).send().await.unwrap().json().await.unwrap();
    list["items"].as_array().unwrap_or_else(|| panic!("{list}")).clone()
}

#[tokio::test]
async fn notes_are_written_listed_shown_and_deleted() {
    let app = TestApp::start().await;
    for subject in subjects(&app).await {
        let url = format!("/v1{subject}/notes");
        assert_eq!(listed(&app, &url).await, Vec::<Value>::new());
        let text = "<b>K\u{e4}fer</b>\r\nleft & right wing  ";
        let write = |key: &'static str, text: &str| {
            app.post(&url).header("idempotency-key", key).json(&json!({ "text": text })).send()
        };
        let first = write("one", text).await.unwrap();
        assert_eq!(first.status(), CREATED);
        let first: Value = first.json().await.unwrap();
        assert_eq!(first["text"], "<b>K\u{e4}fer</b>\nleft & right wing");
        assert_eq!(first["author"], Value::Null, "no token is required");
        let again = write("one", text).await.unwrap();
        assert_eq!((again.status(), &again.headers()["idempotency-replayed"]), (CREATED, &"true".parse().unwrap()));
        assert_eq!(again.json::<Value>().await.unwrap(), first);
        problem(write("one", "other").await.unwrap(), 422, "idempotency_key_reused").await;
        let second: Value = write("two", "second").await.unwrap().json().await.unwrap();
        assert_eq!(listed(&app, &url).await, [first.clone(), second.clone()], "the oldest first");

        let shown = page(&app, &subject).await;
        assert!(shown.contains("&lt;b&gt;K\u{e4}fer&lt;/b&gt;</p><p>left &amp; right wing"), "{shown}");
        assert!(shown.contains("maxlength=\"2000\"") && shown.contains("Delete this note"), "{shown}");

        let of = |note: &Value| format!("{url}/{}", note["id"].as_str().unwrap());
        assert_eq!(app.delete(&of(&first)).send().await.unwrap().status(), StatusCode::NO_CONTENT);
        for none in [of(&first), format!("{url}/7")] {
            problem(app.delete(&none).send().await.unwrap(), 404, "not_found").await;
        }
        assert_eq!(listed(&app, &url).await, [second]);
    }
}

#[tokio::test]
async fn a_note_has_1_to_2000_characters_and_an_object_at_most_100_notes() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let url = "/v1/scans/bee/notes";
    let write = |body: Value| app.post(url).json(&body).send();
    let longest = "\u{4f60}".repeat(2000);
    assert_eq!(write(json!({ "text": longest })).await.unwrap().status(), CREATED);
    for (body, part) in [
        (json!({ "text": format!("{longest}x") }), "2001 characters"),
        (json!({ "text": " \n" }), "no characters"),
        (json!({ "text": "a\u{0}" }), "control character"),
        (json!({}), "text"),
        (json!({ "text": "a", "author": "ann" }), "author"),
    ] {
        let told = problem(write(body).await.unwrap(), 400, "invalid_request").await;
        assert!(told["detail"].as_str().unwrap().contains(part), "{told}");
    }
    for _ in 1..100 {
        assert_eq!(write(json!({ "text": "a" })).await.unwrap().status(), CREATED);
    }
    let full = problem(write(json!({ "text": "a" })).await.unwrap(), 409, "conflict").await;
    assert!(full["detail"].as_str().unwrap().contains("100 notes"), "{full}");
    assert!(!page(&app, "/scans/bee").await.contains("Add the note"), "the page has no form that would be refused");
    for (none, code) in [
        ("/v1/scans/wasp/notes", "scan_not_found"),
        ("/v1/profiles/rig/other/notes", "profile_not_found"),
        ("/v1/stacks/0190b1a6-0000-7000-8000-000000000000/notes", "not_found"),
    ] {
        problem(app.get(none).send().await.unwrap(), 404, code).await;
        problem(app.post(none).json(&json!({ "text": "a" })).send().await.unwrap(), 404, code).await;
    }
}

#[tokio::test]
async fn a_note_has_its_author_who_may_delete_it_and_so_may_an_admin() {
    let app = TestApp::start().await;
    let subjects = subjects(&app).await;
    let base = app.asking_for_tokens().await;
    let both = [Scope::Read, Scope::StacksWrite, Scope::ProfilesWrite];
    let (ann, ben) = (token(&app, "ann", &both).await, token(&app, "ben", &both).await);
    let (reader, admin) = (token(&app, "reader", &[Scope::Read]).await, token(&app, "admin", &[Scope::Admin]).await);
    for subject in &subjects {
        let url = format!("{base}/v1{subject}/notes");
        let write = |token: &str| app.client.post(&url).bearer_auth(token).json(&json!({ "text": "a" })).send();
        let delete = |token: &str, note: &Value| {
            app.client.delete(format!("{url}/{}", note["id"].as_str().unwrap())).bearer_auth(token).send()
        };
        problem(write(&reader).await.unwrap(), 403, "forbidden").await;
        for _ in 0..2 {
            assert_eq!(write(&ann).await.unwrap().status(), CREATED);
        }
        let list: Value = app.client.get(&url).bearer_auth(&reader).send().await.unwrap().json().await.unwrap();
        let notes = list["items"].as_array().unwrap();
        assert!(notes.len() == 2 && notes.iter().all(|note| note["author"] == "ann"), "{list}");

        let shown = async |token: &str| {
            let got = app.client.get(format!("{base}{subject}")).bearer_auth(token).header("accept", HTML).send().await;
            checked(got.unwrap()).await
        };
        let buttons = |text: &str| text.matches("Delete this note").count();
        assert_eq!([buttons(&shown(&ann).await), buttons(&shown(&ben).await)], [2, 0]);
        let text = shown(&reader).await;
        assert!(text.contains("ann, ") && !text.contains("Add the note") && !text.contains("notes.js"), "{text}");

        let told = problem(delete(&ben, &notes[0]).await.unwrap(), 403, "forbidden").await;
        assert!(told["detail"].as_str().unwrap().contains("its author"), "{told}");
        assert_eq!(delete(&ann, &notes[0]).await.unwrap().status(), StatusCode::NO_CONTENT);
        assert_eq!(delete(&admin, &notes[1]).await.unwrap().status(), StatusCode::NO_CONTENT);
    }
}

#[tokio::test]
async fn with_isolation_the_notes_of_others_stay_with_their_stacks_and_scans() {
    let app = TestApp::start_with(|policy| (policy.auth_required, policy.isolate_tokens) = (true, true)).await;
    let all = [Scope::Read, Scope::StacksWrite, Scope::ProfilesWrite];
    let (ann, ben) = (token(&app, "ann", &all).await, token(&app, "ben", &all).await);
    let as_ann = |request: reqwest::RequestBuilder| request.bearer_auth(&ann).send();
    as_ann(app.put("/v1/profiles/rig/lens").json(&crate::app::profile(2))).await.unwrap();
    as_ann(app.put("/v1/scans/bee").json(&json!({ "rig": "rig", "lens": "lens" }))).await.unwrap();
    let sent = app.post(crate::access::POST).body(crate::app::stack_zip(2, 0));
    let stack: Value = as_ann(sent).await.unwrap().json().await.unwrap();
    for (url, code) in [
        (format!("/v1/stacks/{}/notes", id(&stack)), "not_found"),
        ("/v1/scans/bee/notes".to_owned(), "scan_not_found"),
    ] {
        let written = as_ann(app.post(&url).json(&json!({ "text": "a" }))).await.unwrap();
        assert_eq!(written.status(), CREATED, "{url}");
        let note: Value = written.json().await.unwrap();
        problem(app.get(&url).bearer_auth(&ben).send().await.unwrap(), 404, code).await;
        let write = app.post(&url).bearer_auth(&ben).json(&json!({ "text": "b" }));
        problem(write.send().await.unwrap(), 404, code).await;
        let delete = app.delete(&format!("{url}/{}", note["id"].as_str().unwrap())).bearer_auth(&ben);
        problem(delete.send().await.unwrap(), 404, code).await;
    }
    // a profile belongs to a rig, not to a token
    let url = "/v1/profiles/rig/lens/notes";
    assert_eq!(as_ann(app.post(url).json(&json!({ "text": "a" }))).await.unwrap().status(), CREATED);
    let list: Value = app.get(url).bearer_auth(&ben).send().await.unwrap().json().await.unwrap();
    assert_eq!(list["items"][0]["author"], "ann", "{list}");
}
