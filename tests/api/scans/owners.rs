//! Scans where each token sees only its own.

use pinstack::store::tokens::Scope;
use reqwest::{RequestBuilder, Response};
use serde_json::{Value, json};

use super::names;
use crate::{
    access::token,
    app::{TestApp, problem, profile, stack_zip},
};

#[tokio::test]
async fn with_isolation_a_token_can_neither_see_nor_change_the_scan_of_another() {
    let app = TestApp::start_with(|policy| (policy.auth_required, policy.isolate_tokens) = (true, true)).await;
    let both = [Scope::StacksWrite, Scope::Read];
    let (ann, ben) = (token(&app, "ann", &both).await, token(&app, "ben", &both).await);
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    let send = async |request: RequestBuilder, token: &str| -> Response {
        request.bearer_auth(token).send().await.expect("an answer")
    };
    let stored = send(app.put("/v1/profiles/rig/lens").json(&profile(2)), &admin).await;
    assert!(stored.status().is_success());
    let scan = json!({ "rig": "rig", "lens": "lens", "taxon": "Apis" });
    assert_eq!(send(app.put("/v1/scans/bee-42").json(&scan), &ann).await.status(), 201);
    let stack = || app.post("/v1/stacks?rig=rig&lens=lens&scan=bee-42&pan_deg=0&tilt_deg=0").body(stack_zip(2, 2));
    assert_eq!(send(stack(), &ann).await.status(), 202);

    let other = json!({ "rig": "other", "lens": "lens" });
    let upload = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", 100);
    // the scan "bee-42", purpose "scan"
    let upload = upload.header("upload-metadata", "scan YmVlLTQy,purpose c2Nhbg==");
    for request in [
        app.get("/v1/scans/bee-42"),
        app.delete("/v1/scans/bee-42"),
        app.get("/v1/scans/bee-42/views.csv"),
        app.get("/v1/scans/bee-42/bundle?layout=colmap"),
        app.post("/v1/scans/bee-42/rerun"),
        app.post("/v1/scans/bee-42/archive").body(stack_zip(2, 2)),
        app.post("/v1/scans/bee-42/archive?dry_run=true").body(stack_zip(2, 2)),
        stack(),
        upload,
    ] {
        problem(send(request, &ben).await, 404, "scan_not_found").await;
    }
    // a name is unique among all tokens, so that it is in use cannot be a secret
    problem(send(app.put("/v1/scans/bee-42").json(&other), &ben).await, 409, "conflict").await;
    // a misspelt name is not completed from the scans of others
    let misspelt = problem(send(app.get("/v1/scans/bee42"), &ben).await, 404, "scan_not_found").await;
    assert!(!misspelt["detail"].as_str().unwrap().contains("bee-42"), "{misspelt}");

    for (token, listed) in [(&ann, vec!["bee-42"]), (&ben, vec![]), (&admin, vec!["bee-42"])] {
        let page: Value = send(app.get("/v1/scans"), token).await.json().await.unwrap();
        assert_eq!(names(&page["items"]), listed);
    }
    let table: Value = send(app.get("/v1/scans/bee-42"), &ann).await.json().await.unwrap();
    assert_eq!(
        (&table["rig"], &table["taxon"], &table["summary"]["views"]),
        (&json!("rig"), &json!("Apis"), &json!(1))
    );
}
