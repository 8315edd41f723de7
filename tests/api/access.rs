//! Tokens, scopes, isolation and quotas.

use pinstack::{
    contract::Name,
    store::tokens::{NewToken, Scope, mint},
};
use reqwest::{RequestBuilder, StatusCode};
use serde_json::{Value, json};
use uuid::Uuid;

use crate::app::{TestApp, id, problem, profile, stack_zip};

pub const POST: &str = "/v1/stacks?rig=rig&lens=lens";

pub async fn token(app: &TestApp, name: &str, scopes: &[Scope]) -> String {
    token_with_quota(app, name, scopes, None).await
}

async fn token_with_quota(app: &TestApp, name: &str, scopes: &[Scope], quota_bytes: Option<u64>) -> String {
    let (id, secret, text) = mint().unwrap();
    let new =
        NewToken { id, name: Name::new(name).unwrap(), digest: secret.digest(), scopes: scopes.to_vec(), quota_bytes };
    assert!(app.store.metadata.add_token(&new).await.unwrap());
    text
}

/// The secret part of a token; it may contain a `_`.
pub fn secret_of(token: &str) -> &str {
    token.splitn(3, '_').nth(2).expect("a token has three parts")
}

async fn guarded() -> TestApp {
    TestApp::start_with(|policy| policy.auth_required = true).await
}

async fn status(request: RequestBuilder, token: &str) -> u16 {
    request.bearer_auth(token).send().await.unwrap().status().as_u16()
}

#[tokio::test]
async fn without_a_token_only_health_and_the_contract_are_shown() {
    let app = guarded().await;
    for open in ["/healthz", "/readyz", "/openapi.json", "/docs/"] {
        assert_eq!(app.get(open).send().await.unwrap().status(), StatusCode::OK, "{open}");
    }
    for closed in ["/v1/info", "/metrics", "/v1/stacks", "/v1/nothing"] {
        let answer = app.get(closed).send().await.unwrap();
        assert_eq!(answer.headers()["www-authenticate"], "Bearer", "{closed}");
        problem(answer, 401, "unauthorized").await;
    }
    // the reason arrives although the client is still sending
    problem(app.post(POST).body(vec![0; 8 << 20]).send().await.unwrap(), 401, "unauthorized").await;
}

#[tokio::test]
async fn each_scope_allows_exactly_its_requests() {
    let app = guarded().await;
    let (profiles, stacks, read, admin) = (
        token(&app, "profiles", &[Scope::ProfilesWrite]).await,
        token(&app, "stacks", &[Scope::StacksWrite]).await,
        token(&app, "read", &[Scope::Read]).await,
        token(&app, "admin", &[Scope::Admin]).await,
    );
    for (token, allowed) in [(&stacks, false), (&read, false), (&profiles, true), (&admin, true)] {
        let put = app.put("/v1/profiles/rig/lens").json(&profile(2)).bearer_auth(token).send().await.unwrap();
        if allowed {
            assert!(put.status().is_success());
        } else {
            let told = problem(put, 403, "forbidden").await;
            assert!(told["detail"].as_str().unwrap().contains("needs: profiles:write"), "{told}");
        }
    }
    for (token, wanted) in [(&profiles, 403), (&read, 403), (&stacks, 202), (&admin, 202)] {
        assert_eq!(status(app.post(POST).body(stack_zip(2, 0)), token).await, wanted);
    }
    for (token, wanted) in [(&profiles, 403), (&stacks, 403), (&read, 200), (&admin, 200)] {
        assert_eq!(status(app.get("/v1/stacks"), token).await, wanted);
    }
}

#[tokio::test]
async fn a_resumable_upload_needs_the_scope_of_its_purpose() {
    let app = guarded().await;
    let profiles = token(&app, "profiles", &[Scope::ProfilesWrite]).await;
    let stacks = token(&app, "stacks", &[Scope::StacksWrite]).await;
    assert!(
        app.put("/v1/profiles/rig/lens")
            .json(&profile(2))
            .bearer_auth(&profiles)
            .send()
            .await
            .unwrap()
            .status()
            .is_success()
    );
    let begin = |purpose: &str| {
        let metadata = format!("rig cmln,lens bGVucw==,purpose {purpose}");
        let create = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", 100);
        create.header("upload-metadata", metadata)
    };
    let (stack, calibration) = ("c3RhY2s=", "Y2FsaWJyYXRpb24=");
    for (token, purpose, wanted) in
        [(&stacks, stack, 201), (&stacks, calibration, 403), (&profiles, stack, 403), (&profiles, calibration, 201)]
    {
        assert_eq!(status(begin(purpose), token).await, wanted);
    }
}

#[tokio::test]
async fn a_token_with_another_secret_or_revoked_is_refused() {
    let app = guarded().await;
    let good = token(&app, "rig-pc", &[Scope::Read]).await;
    let other = token(&app, "other", &[Scope::Read]).await;
    assert_eq!(status(app.get("/v1/stacks"), &good).await, 200);
    // the id of one with the secret of another
    let mixed = good.replace(secret_of(&good), secret_of(&other));
    for wrong in [mixed, good[..good.len() - 2].to_owned(), "pinstack_".into(), "x".into()] {
        assert_eq!(status(app.get("/v1/stacks"), &wrong).await, 401, "{wrong}");
    }
    let basic = app.get("/v1/stacks").header("authorization", format!("Basic {good}")).send().await.unwrap();
    problem(basic, 401, "unauthorized").await;
    assert!(app.store.metadata.revoke_token(&Name::new("rig-pc").unwrap()).await.unwrap());
    problem(app.get("/v1/stacks").bearer_auth(&good).send().await.unwrap(), 401, "unauthorized").await;
    assert_eq!(status(app.get("/v1/stacks"), &other).await, 200);
}

#[tokio::test]
async fn with_isolation_a_token_sees_only_its_own_stacks() {
    let app = TestApp::start_with(|policy| (policy.auth_required, policy.isolate_tokens) = (true, true)).await;
    let both = [Scope::StacksWrite, Scope::Read];
    let (ann, ben) = (token(&app, "ann", &both).await, token(&app, "ben", &both).await);
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    assert!(
        app.put("/v1/profiles/rig/lens")
            .json(&profile(2))
            .bearer_auth(&admin)
            .send()
            .await
            .unwrap()
            .status()
            .is_success()
    );
    let send = |token: &str| {
        app.post(POST).header("idempotency-key", "view 1").bearer_auth(token).body(stack_zip(2, 0)).send()
    };
    let of_ann: Value = send(&ann).await.unwrap().json().await.unwrap();
    // the same key of another token is another key
    let answer = send(&ben).await.unwrap();
    assert!(answer.headers().get("idempotency-replayed").is_none());
    let of_ben: Value = answer.json().await.unwrap();
    assert_ne!(id(&of_ann), id(&of_ben));
    assert!(send(&ann).await.unwrap().headers().contains_key("idempotency-replayed"));

    let url = format!("/v1/stacks/{}", id(&of_ann));
    for path in ["", "/events", "/image", "/metrics", "/preview", "/upload"] {
        let path = format!("{url}{path}");
        problem(app.get(&path).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
    }
    problem(app.post(&format!("{url}/cancel")).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
    problem(app.post(&format!("{url}/rerun")).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
    problem(app.delete(&url).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
    for token in [&ann, &admin] {
        assert_eq!(status(app.get(&url), token).await, 200);
    }
    for (token, wanted) in
        [(&ann, vec![id(&of_ann)]), (&ben, vec![id(&of_ben)]), (&admin, vec![id(&of_ben), id(&of_ann)])]
    {
        let page: Value = app.get("/v1/stacks").bearer_auth(token).send().await.unwrap().json().await.unwrap();
        let listed: Vec<Uuid> = page["items"].as_array().unwrap().iter().map(id).collect();
        assert_eq!(listed, wanted);
    }

    // a resumable upload, and the stack that it becomes
    let zip = stack_zip(2, 0);
    let create = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", zip.len());
    let create = create.header("upload-metadata", "rig cmln,lens bGVucw==").bearer_auth(&ann);
    let upload = create.send().await.unwrap().headers()["location"].to_str().unwrap().to_owned();
    let piece = |token: &str| {
        let patch = app.client.patch(format!("{}{upload}", app.base)).header("tus-resumable", "1.0.0");
        let patch = patch.header("upload-offset", 0).header("content-type", "application/offset+octet-stream");
        patch.bearer_auth(token).body(zip.clone()).send()
    };
    problem(app.get(&upload).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
    problem(piece(&ben).await.unwrap(), 404, "not_found").await;
    let job = piece(&ann).await.unwrap().headers()["pinstack-job"].to_str().unwrap().to_owned();
    assert_eq!(status(app.get(&job), &ann).await, 200);
    problem(app.get(&job).bearer_auth(&ben).send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn the_contract_documents_the_scope_of_each_operation() {
    let document = pinstack::http::router::DOCUMENT.value();
    let needed = |path: &str, method: &str| document["paths"][path][method]["security"].clone();
    let scopes = |path: &str, method: &str| document["paths"][path][method]["x-required-scopes"].clone();
    assert_eq!(needed("/v1/stacks", "post"), json!([{ "token": [] }]));
    assert_eq!(scopes("/v1/stacks", "post"), json!(["stacks:write"]));
    assert_eq!(scopes("/v1/stacks/{id}/image", "get"), json!(["read"]));
    assert_eq!(scopes("/v1/uploads", "post"), json!(["stacks:write", "profiles:write"]));
    assert_eq!(needed("/healthz", "get"), json!([]), "no token is asked for");
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let told = &operation["x-required-scopes"];
            if (method.as_str(), path.as_str()) == ("get", "/v1/uploads") {
                assert_eq!(*told, json!(["admin"]), "it lists the uploads of all tokens");
                continue;
            }
            assert_ne!(*told, json!(["admin"]), "{method} {path}: the table of scopes has no line for it");
        }
    }
}

#[tokio::test]
async fn a_token_cannot_exceed_its_quota() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let zip = stack_zip(2, 2);
    let length = zip.len() as u64;
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    let stored = app.put("/v1/profiles/rig/lens").bearer_auth(&admin).json(&profile(2)).send().await.unwrap();
    assert_eq!(stored.status(), StatusCode::CREATED);
    let small = token_with_quota(&app, "small", &[Scope::StacksWrite, Scope::Read], Some(length * 3 / 2)).await;
    let post = |token: &str| app.post(POST).bearer_auth(token).body(zip.clone());
    let first: Value = post(&small).send().await.unwrap().json().await.unwrap();
    assert_eq!(first["state"], "queued", "{first}");

    let told = problem(post(&small).send().await.unwrap(), 507, "insufficient_storage").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(["'small'", &format!("{length} of {} are used", length * 3 / 2)].iter().all(|part| detail.contains(part)));
    // a rerun counts in full: it keeps the zip when the first stack is deleted
    let again = app.post(&format!("/v1/stacks/{}/rerun", id(&first))).bearer_auth(&small);
    problem(again.send().await.unwrap(), 507, "insufficient_storage").await;
    // a body of unknown length
    let chunks = futures::stream::iter([Ok::<_, std::io::Error>(zip.clone())]);
    let streamed = app.post(POST).bearer_auth(&small).body(reqwest::Body::wrap_stream(chunks));
    problem(streamed.send().await.unwrap(), 507, "insufficient_storage").await;
    let in_pieces = app.post("/v1/uploads").bearer_auth(&small).header("tus-resumable", "1.0.0");
    let in_pieces = in_pieces.header("upload-length", length).header("upload-metadata", "rig cmln,lens bGVucw==");
    problem(in_pieces.send().await.unwrap(), 507, "insufficient_storage").await;
    assert_eq!(post(&admin).send().await.unwrap().status(), StatusCode::ACCEPTED, "others have their own");

    let gone = app.delete(&format!("/v1/stacks/{}", id(&first))).bearer_auth(&small).send().await.unwrap();
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    assert_eq!(post(&small).send().await.unwrap().status(), StatusCode::ACCEPTED, "and there is room again");
}

/// Creates a resumable upload for `rig/lens`.
async fn upload_of(app: &TestApp, token: &str, length: u64) -> reqwest::Response {
    let request = app.post("/v1/uploads").bearer_auth(token).header("tus-resumable", "1.0.0");
    let request = request.header("upload-length", length);
    request.header("upload-metadata", "rig cmln,lens bGVucw==,filename YmVlLnppcA==").send().await.unwrap()
}

#[tokio::test]
async fn a_quota_holds_however_many_requests_come_at_once() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    app.put("/v1/profiles/rig/lens").bearer_auth(&admin).json(&profile(2)).send().await.unwrap();
    let zip = stack_zip(2, 0);
    let length = zip.len() as u64;
    let small = token_with_quota(&app, "small", &[Scope::StacksWrite], Some(length * 5 / 2)).await;
    let small_id = app.store.metadata.tokens().await.unwrap().iter().find(|t| t.name.as_str() == "small").unwrap().id;
    let posts = (0..30).map(|i| {
        let (app, zip, small) = (&app, zip.clone(), &small);
        async move {
            let post = app.post(POST).bearer_auth(small);
            let answer = match i % 3 {
                0 => post.body(zip).send().await.unwrap(),
                // of unknown length
                1 => {
                    let chunks = futures::stream::iter([Ok::<_, std::io::Error>(zip)]);
                    post.body(reqwest::Body::wrap_stream(chunks)).send().await.unwrap()
                }
                _ => upload_of(app, small, length).await,
            };
            answer.status().as_u16()
        }
    });
    let mut told = futures::future::join_all(posts).await;
    told.sort_unstable();
    let accepted = told.iter().filter(|status| **status != 507).count();
    assert!((1..=2).contains(&accepted), "{told:?}");
    assert!(told.iter().all(|status| [201, 202, 507].contains(status)), "{told:?}");
    let used = app.store.metadata.used_bytes(small_id).await.unwrap();
    assert_eq!(used, accepted as u64 * length);
    assert_eq!(app.spooled(), 0);

    // repeats of one request count once towards the quota, even while the first arrives
    let other = token_with_quota(&app, "other", &[Scope::StacksWrite], Some(length * 3 / 2)).await;
    let repeats = (0..10)
        .map(|_| app.post(POST).bearer_auth(&other).header("idempotency-key", "view 7").body(zip.clone()).send());
    for answer in futures::future::join_all(repeats).await {
        assert_eq!(answer.unwrap().status(), StatusCode::ACCEPTED);
    }
}

#[tokio::test]
async fn an_admin_lists_and_deletes_the_open_uploads_of_all_tokens() {
    let app = TestApp::start_with(|policy| {
        (policy.auth_required, policy.isolate_tokens, policy.max_open_uploads) = (true, true, 2);
    })
    .await;
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    app.put("/v1/profiles/rig/lens").bearer_auth(&admin).json(&profile(2)).send().await.unwrap();
    let (ann, ben) =
        (token(&app, "ann", &[Scope::StacksWrite, Scope::Read]).await, token(&app, "ben", &[Scope::StacksWrite]).await);
    let begun =
        [upload_of(&app, &ann, 1000).await, upload_of(&app, &ann, 2000).await, upload_of(&app, &ben, 3000).await];
    let urls = begun.map(|answer| answer.headers()["location"].to_str().unwrap().to_owned());
    let refused = problem(upload_of(&app, &ann, 10).await, 503, "queue_full").await;
    assert!(refused["detail"].as_str().unwrap().contains("2 uploads of this token"), "{refused}");

    let list = async |query: &str| -> Value {
        app.get(&format!("/v1/uploads{query}")).bearer_auth(&admin).send().await.unwrap().json().await.unwrap()
    };
    let page = list("?limit=2").await;
    let shown = |page: &Value| -> Vec<(String, Value)> {
        let items = page["items"].as_array().unwrap().iter();
        items.map(|item| (format!("/v1/uploads/{}", item["id"].as_str().unwrap()), item["token"].clone())).collect()
    };
    assert_eq!(shown(&page), [(urls[2].clone(), "ben".into()), (urls[1].clone(), "ann".into())]);
    let first = &page["items"][0];
    assert_eq!((&first["filename"], &first["rig"], &first["lens"]), (&json!("bee.zip"), &json!("rig"), &json!("lens")));
    assert_eq!((&first["offset"], &first["length"], &first["last_byte_at"]), (&json!(0), &json!(3000), &Value::Null));
    let rest = list(&format!("?limit=2&cursor={}", page["next_cursor"].as_str().unwrap())).await;
    assert_eq!((shown(&rest), &rest["next_cursor"]), (vec![(urls[0].clone(), "ann".into())], &Value::Null));
    problem(app.get("/v1/uploads?state=x").bearer_auth(&admin).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.get("/v1/uploads").bearer_auth(&ann).send().await.unwrap(), 403, "forbidden").await;

    let gone = app.delete(&urls[1]).bearer_auth(&admin).header("tus-resumable", "1.0.0").send().await.unwrap();
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    assert_eq!(shown(&list("").await).len(), 2);
    assert_eq!(upload_of(&app, &ann, 10).await.status(), StatusCode::CREATED);
}
