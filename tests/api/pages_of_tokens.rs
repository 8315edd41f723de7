//! The web pages for a token: the form that takes it, its rights, and the work of others.

use pinstack::store::tokens::Scope;
use reqwest::StatusCode;
use serde_json::json;

use crate::{
    access::token,
    app::{TestApp, id, problem, profile, stack_zip},
    pages::{HTML, POST, checked, page, still},
};

#[tokio::test]
async fn pages_lead_to_the_form_for_a_token_and_a_token_opens_them() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let secret = token(&app, "technician", &[Scope::Read, Scope::StacksWrite]).await;
    let client = still();
    let url = |path: &str| format!("{}{path}", app.base);
    let to = client.get(url("/scans?cursor=1")).header("accept", HTML).send().await.unwrap();
    assert_eq!(
        (to.status(), &to.headers()["location"]),
        (StatusCode::SEE_OTHER, &"/sign-in?next=%2Fscans%3Fcursor%3D1".parse().unwrap())
    );
    assert!(page(&app, "/sign-in?next=%2Fscans").await.contains("value=\"/scans\""));
    // a link of a page to the API, when the session has ended
    let report = || client.get(url("/v1/calibrations/x/report?a=b")).header("accept", HTML);
    let to = report().header("sec-fetch-dest", "document").send().await.unwrap();
    assert_eq!(to.headers()["location"], "/sign-in?next=%2Fv1%2Fcalibrations%2Fx%2Freport%3Fa%3Db");
    problem(report().send().await.unwrap(), 401, "unauthorized").await;

    let sign_in = |form: String, origin: &str| {
        let request = client.post(url("/sign-in")).header("origin", origin.to_owned()).header("accept", HTML);
        request.header("content-type", "application/x-www-form-urlencoded").body(form).send()
    };
    let wrong = sign_in("token=pinstack_x_y&next=/scans".into(), &app.base).await.unwrap();
    assert_eq!((wrong.status(), wrong.headers().get("set-cookie")), (StatusCode::FORBIDDEN, None));
    assert!(checked(wrong).await.contains("This is not a token"));
    let foreign = sign_in(format!("token={secret}"), "https://evil.example").await.unwrap();
    assert_eq!((foreign.status(), foreign.headers().get("set-cookie")), (StatusCode::FORBIDDEN, None));
    let right = sign_in(format!("token={secret}&next=%2Fscans"), &app.base).await.unwrap();
    assert_eq!((right.status(), &right.headers()["location"]), (StatusCode::SEE_OTHER, &"/scans".parse().unwrap()));
    let cookie = right.headers()["set-cookie"].to_str().unwrap().to_owned();
    assert_eq!(cookie, format!("pinstack_token={secret}; Path=/; HttpOnly; SameSite=Strict"));
    // over TLS that a trusted proxy ends
    let form = client.post(url("/sign-in")).header("origin", app.base.clone()).header("x-forwarded-proto", "https");
    let tls = form.body(format!("token={secret}")).send().await.unwrap();
    assert!(tls.headers()["set-cookie"].to_str().unwrap().ends_with("; Secure"), "{:?}", tls.headers());

    let cookie = format!("pinstack_token={secret}");
    let with = |request: reqwest::RequestBuilder| request.header("cookie", cookie.clone()).header("accept", HTML);
    let shown = checked(with(client.get(url("/"))).send().await.unwrap()).await;
    assert!(shown.contains("technician") && shown.contains("Sign out") && !shown.contains(&secret), "{shown}");
    assert_eq!(with(client.get(url("/v1/stacks"))).send().await.unwrap().status(), StatusCode::OK);
    // changes by cookie come from own pages
    let put = || with(client.put(url("/v1/scans/bee"))).json(&json!({ "rig": "rig", "lens": "lens" }));
    for request in [put(), put().header("origin", "http://127.0.0.1:1"), put().header("sec-fetch-site", "same-site")] {
        problem(request.send().await.unwrap(), 403, "cross_origin_request").await;
    }
    assert_eq!(put().header("origin", app.base.clone()).send().await.unwrap().status(), StatusCode::CREATED);
    // the header counts before the cookie
    let header = with(client.get(url("/v1/stacks"))).bearer_auth("pinstack_x_y").send().await.unwrap();
    assert_eq!(header.status(), StatusCode::UNAUTHORIZED);
    let out = with(client.post(url("/sign-out"))).header("origin", app.base.clone()).send().await.unwrap();
    assert!(out.headers()["set-cookie"].to_str().unwrap().contains("pinstack_token=; "), "{:?}", out.headers());
}

#[tokio::test]
async fn a_token_that_may_only_read_sees_no_buttons_that_are_refused() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let stack = id(&app.with_stack("&scan=bee").await);
    app.finish(&app.claim().await).await;
    let base = app.asking_for_tokens().await;
    let reader = token(&app, "reader", &[Scope::Read]).await;
    let get = async |path: &str| {
        let request = app.client.get(format!("{base}{path}")).bearer_auth(&reader).header("accept", HTML);
        request.send().await.unwrap()
    };
    for path in ["/", "/stacks", "/scans", "/scans/bee", "/profiles", &format!("/stacks/{stack}")] {
        let text = checked(get(path).await).await;
        for button in ["id=\"delete\"", "id=\"cancel\"", "id=\"rerun\"", "href=\"/send"] {
            assert!(!text.contains(button), "{button} on {path}");
        }
    }
    assert_eq!(get("/send").await.status(), StatusCode::FORBIDDEN);
    let writer = token(&app, "writer", &[Scope::StacksWrite]).await;
    let only_writes = app.client.get(format!("{base}/")).bearer_auth(&writer).header("accept", HTML);
    let refused = only_writes.send().await.unwrap();
    assert_eq!(refused.status(), StatusCode::FORBIDDEN);
    assert!(checked(refused).await.contains("has the scopes"));
}

#[tokio::test]
async fn an_isolated_token_sees_no_work_of_others_on_any_page() {
    let app = TestApp::start_with(|policy| {
        policy.auth_required = true;
        policy.isolate_tokens = true;
    })
    .await;
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    let [ann, bob] = ["ann", "bob"].map(|name| (name, [Scope::Read, Scope::StacksWrite]));
    let (ann, bob) = (token(&app, ann.0, &ann.1).await, token(&app, bob.0, &bob.1).await);
    let put = app.put("/v1/profiles/rig/lens").json(&profile(2)).bearer_auth(&admin);
    assert!(put.send().await.unwrap().status().is_success());
    let scan = json!({ "rig": "rig", "lens": "lens" });
    assert!(app.put("/v1/scans/anns").bearer_auth(&ann).json(&scan).send().await.unwrap().status().is_success());
    let sent = app.post(&format!("{POST}&label=secret-beetle&scan=anns")).bearer_auth(&ann).body(stack_zip(2, 2));
    let stack = id(&sent.send().await.unwrap().json().await.unwrap());
    app.finish(&app.claim().await).await;
    let own = app.post(&format!("{POST}&label=bobs")).bearer_auth(&bob).body(stack_zip(2, 2));
    let bobs = id(&own.send().await.unwrap().json().await.unwrap());
    app.finish(&app.claim().await).await;
    let get =
        async |path: &str, token: &str| app.get(path).bearer_auth(token).header("accept", HTML).send().await.unwrap();
    // both sent the same pictures
    let runs = [format!("/stacks/{bobs}?compare={stack}"), format!("/stacks/{bobs}/runs?{stack}=1")];
    for path in ["/", "/stacks", "/scans", "/send", &runs[0], &runs[1]] {
        let text = checked(get(path, &bob).await).await;
        assert!(!text.contains("secret-beetle") && !text.contains("anns"), "{path}: {text}");
    }
    let hidden = [
        format!("/stacks/{stack}"),
        format!("/stacks/{stack}/runs"),
        format!("/stacks/{stack}/thumbnail"),
        format!("/stacks/{stack}/tiles/image/0/0/0"),
        "/scans/anns".into(),
    ];
    for path in &hidden {
        assert_eq!(get(path, &bob).await.status(), StatusCode::NOT_FOUND, "{path}");
        assert_eq!(get(path, &ann).await.status(), StatusCode::OK, "{path}");
    }
}
