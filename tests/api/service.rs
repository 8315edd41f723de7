use reqwest::{Method, StatusCode};
use serde_json::Value;

use crate::app::{TestApp, problem};

#[tokio::test]
async fn the_request_id_of_the_client_is_kept_and_else_one_is_made() {
    let app = TestApp::start().await;
    let kept = app.get("/healthz").header("x-request-id", "rig-7/42").send().await.unwrap();
    assert_eq!(kept.headers()["x-request-id"], "rig-7/42");
    let made = app.get("/healthz").send().await.unwrap();
    assert!(uuid::Uuid::parse_str(made.headers()["x-request-id"].to_str().unwrap()).is_ok());
    let long = app.get("/healthz").header("x-request-id", "x".repeat(1000)).send().await.unwrap();
    assert!(long.headers()["x-request-id"].len() < 200);
}

#[tokio::test]
async fn unknown_urls_methods_and_ids_are_problems() {
    let app = TestApp::start().await;
    problem(app.get("/v1/nothing").send().await.unwrap(), 404, "not_found").await;
    problem(app.get("/docs/nothing.js").send().await.unwrap(), 404, "not_found").await;
    let wrong = app.client.request(Method::PATCH, format!("{}/v1/stacks", app.base)).send().await.unwrap();
    let allowed = wrong.headers()["allow"].to_str().unwrap().to_owned();
    assert!(allowed.contains("GET") && allowed.contains("POST") && allowed.contains("PUT"), "{allowed}");
    problem(wrong, 405, "method_not_allowed").await;
    problem(app.get("/v1/stacks/7").send().await.unwrap(), 404, "not_found").await;
    problem(app.get(&format!("/v1/stacks/{}", uuid::Uuid::now_v7())).send().await.unwrap(), 404, "not_found").await;
    problem(app.get("/v1/profiles/%ff/lens").send().await.unwrap(), 400, "invalid_request").await;
}

#[tokio::test]
async fn readiness_looks_at_everything_and_says_what_is_wrong() {
    let app = TestApp::start().await;
    let alive: Value = app.get("/healthz").send().await.unwrap().json().await.unwrap();
    assert_eq!(alive["status"], "ok");
    let ready: Value = app.get("/readyz").send().await.unwrap().json().await.unwrap();
    assert_eq!(ready["ready"], true, "{ready}");

    let full = TestApp::start_with(|policy| policy.min_free_bytes = 1 << 60).await;
    let answer = full.get("/readyz").send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::SERVICE_UNAVAILABLE);
    let told: Value = answer.json().await.unwrap();
    assert_eq!((&told["checks"]["disk"]["ok"], &told["checks"]["database"]["ok"]), (&false.into(), &true.into()));
}

#[tokio::test]
async fn prometheus_sees_requests_by_route_and_jobs_by_state() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    app.get("/metrics").send().await.unwrap();
    let text = app.get("/metrics").send().await.unwrap().text().await.unwrap();
    assert!(
        text.contains("pinstack_http_requests_total{method=\"POST\",route=\"/v1/stacks\",status=\"202\"}"),
        "{text}"
    );
    assert!(text.contains("pinstack_jobs{state=\"queued\"}"), "{text}");
    assert!(text.contains("pinstack_http_request_seconds_bucket"), "{text}");
}

#[tokio::test]
async fn the_documents_come_from_this_server_alone() {
    let app = TestApp::start().await;
    let page = app.get("/docs/").send().await.unwrap();
    assert_eq!(page.status(), StatusCode::OK);
    let policy = page.headers()["content-security-policy"].to_str().unwrap().to_owned();
    assert!(policy.starts_with("default-src 'self'"), "{policy}");
    let page = page.text().await.unwrap();
    let sources: Vec<&str> = page.split(['"', '\'']).filter(|part| part.contains("://")).collect();
    assert!(sources.is_empty(), "{sources:?}");
    assert!(!page.contains("<script>"), "an inline script would be held back by the policy");
    let info: Value = app.get("/v1/info").send().await.unwrap().json().await.unwrap();
    assert_eq!((&info["name"], &info["defaults"]["r1"]), (&"pinstack".into(), &45.into()));
    let served = app.get("/openapi.json").send().await.unwrap().text().await.unwrap();
    assert_eq!(served, pinstack::http::system::openapi::text());
    assert_eq!(app.get("/healthz").send().await.unwrap().headers()["x-content-type-options"], "nosniff");
}

#[test]
fn the_committed_contract_is_the_one_that_is_served() {
    let committed = include_str!("../../openapi/openapi.json");
    let made = pinstack::http::system::openapi::text();
    assert!(
        committed == made,
        "openapi/openapi.json has drifted; write it anew: cargo run -- openapi > openapi/openapi.json"
    );
}

#[test]
fn every_call_of_the_contract_is_documented_with_its_errors() {
    let document = pinstack::http::system::openapi::document();
    for (path, method) in [
        ("/v1/profiles", "get"),
        ("/v1/profiles/{rig}/{lens}", "put"),
        ("/v1/profiles/{rig}/{lens}", "get"),
        ("/v1/profiles/{rig}/{lens}", "delete"),
        ("/v1/profiles/{rig}/{lens}/revisions", "get"),
        ("/v1/profiles/{rig}/{lens}/rig-parameters", "post"),
        ("/v1/profiles/{rig}/{lens}/export", "get"),
        ("/v1/profiles/{rig}/{lens}/import", "post"),
        ("/v1/profiles/{rig}/{lens}/calibrations", "post"),
        ("/v1/stacks", "post"),
        ("/v1/stacks", "get"),
        ("/v1/stacks/{id}", "get"),
        ("/v1/stacks/{id}", "delete"),
        ("/v1/stacks/{id}/events", "get"),
        ("/v1/stacks/{id}/image", "get"),
        ("/v1/stacks/{id}/mask", "get"),
        ("/v1/stacks/{id}/backlight", "get"),
        ("/v1/stacks/{id}/depth", "get"),
        ("/v1/stacks/{id}/preview", "get"),
        ("/v1/stacks/{id}/metrics", "get"),
        ("/v1/stacks/{id}/cancel", "post"),
        ("/v1/uploads", "post"),
        ("/v1/uploads", "options"),
        ("/v1/uploads/{id}", "head"),
        ("/v1/uploads/{id}", "patch"),
        ("/v1/uploads/{id}", "delete"),
        ("/v1/uploads/{id}", "get"),
        ("/v1/calibrations", "get"),
        ("/v1/calibrations/{id}", "get"),
        ("/v1/calibrations/{id}/events", "get"),
        ("/v1/calibrations/{id}/overlay", "get"),
        ("/v1/calibrations/{id}/report", "get"),
        ("/v1/profiles/{rig}/{lens}/drift", "get"),
        ("/healthz", "get"),
        ("/readyz", "get"),
        ("/metrics", "get"),
        ("/openapi.json", "get"),
        ("/v1/info", "get"),
    ] {
        let operation = &document["paths"][path][method];
        let responses = operation["responses"].as_object().unwrap_or_else(|| panic!("{method} {path} is missing"));
        for (status, response) in responses.iter().filter(|(status, _)| status.starts_with(['4', '5'])) {
            let content = response["content"].as_object().unwrap_or_else(|| panic!("{method} {path} {status}"));
            assert!(content.contains_key("application/problem+json") || path == "/readyz", "{method} {path} {status}");
        }
        assert!(operation["summary"].is_string(), "{method} {path} has no summary");
    }
    let text = document.to_string();
    let schemas = &document["components"]["schemas"];
    for reference in text.split("#/components/schemas/").skip(1).filter_map(|rest| rest.split('"').next()) {
        assert!(schemas[reference].is_object(), "the schema {reference} is referred to and missing");
    }
}

/// The operations of the document: method, path, what it says.
fn operations(document: &Value) -> Vec<(&String, &String, &Value)> {
    let paths = document["paths"].as_object().unwrap().iter();
    paths.flat_map(|(path, item)| item.as_object().unwrap().iter().map(move |(m, o)| (m, path, o))).collect()
}

#[test]
fn every_refusal_names_its_codes_with_an_example_of_each() {
    let document = pinstack::http::system::openapi::document();
    let examples = &document["components"]["examples"];
    for (method, path, operation) in operations(&document) {
        for (status, response) in operation["responses"].as_object().unwrap() {
            let Some(told) = response["content"].get("application/problem+json") else { continue };
            let codes = told["schema"]["allOf"][1]["properties"]["code"]["enum"].as_array().unwrap();
            assert!(!codes.is_empty(), "{method} {path} {status} names no code");
            for code in codes {
                let code = code.as_str().unwrap();
                let reference = format!("#/components/examples/{code}");
                assert_eq!(told["examples"][code]["$ref"], reference, "{method} {path} {status}");
                let example: pinstack::model::Problem =
                    serde_json::from_value(examples[code]["value"].clone()).unwrap();
                assert_eq!(example.status.to_string(), *status, "{method} {path}: {code}");
            }
        }
    }
}

#[test]
fn every_code_can_be_found_in_the_document() {
    // what no operation answers by itself: faults of jobs, and of methods that are no operation
    const ELSEWHERE: [&str; 3] = ["target_not_found", "worker_lost", "method_not_allowed"];
    let document = pinstack::http::system::openapi::document();
    let codes = document["components"]["schemas"]["Code"]["enum"].as_array().unwrap();
    let all_operations = operations(&document);
    for code in codes {
        let name = code.as_str().unwrap();
        assert_eq!(document["components"]["examples"][name]["value"]["code"], *code, "{name} has no example");
        let is_answered = all_operations.iter().any(|(_, _, operation)| {
            operation["responses"].as_object().unwrap().values().any(|response| {
                let told = &response["content"]["application/problem+json"]["examples"];
                told.get(name).is_some()
            })
        });
        assert!(is_answered || ELSEWHERE.contains(&name), "no operation is said to answer {name}");
    }
}

#[test]
fn operations_have_names_of_their_own_and_parameters_are_never_null() {
    let document = pinstack::http::system::openapi::document();
    let mut names: Vec<&str> = Vec::new();
    for (method, path, operation) in operations(&document) {
        let name = operation["operationId"].as_str().unwrap();
        assert!(!names.contains(&name), "{method} {path}: {name} is another operation");
        names.push(name);
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            assert!(!parameter["schema"].to_string().contains("null"), "{method} {path}: {parameter}");
        }
    }
}
