use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use pinstack::http::router::DOCUMENT;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, problem};

#[tokio::test]
async fn the_request_id_of_the_client_is_kept_or_one_is_made() {
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
async fn readiness_checks_everything_and_reports_what_is_wrong() {
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
async fn a_service_whose_workers_are_gone_is_not_ready_until_one_is_back() {
    let app = TestApp::start().await;
    let alive = Arc::new(AtomicUsize::new(0));
    app.app.health.watch_workers(Arc::clone(&alive));
    let asked = async || {
        let answer = app.get("/readyz").send().await.unwrap();
        (answer.status(), answer.json::<Value>().await.unwrap())
    };
    let (status, told) = asked().await;
    assert_eq!((status, &told["checks"]["workers"]["ok"]), (StatusCode::SERVICE_UNAVAILABLE, &false.into()), "{told}");
    alive.store(1, Ordering::Relaxed);
    // the result of the checks is kept for a second
    while asked().await.0 != StatusCode::OK {
        tokio::task::yield_now().await;
    }
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
    assert!(text.contains("pinstack_jobs{kind=\"stack\",state=\"queued\"}"), "{text}");
    assert!(text.contains("pinstack_http_request_seconds_bucket"), "{text}");
}

#[tokio::test]
async fn unknown_methods_are_refused_and_make_no_series() {
    // the response does not depend on a token
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    for i in 0..1000 {
        let method = Method::from_bytes(format!("ODD{i:04}").as_bytes()).unwrap();
        let answer = app.client.request(method, format!("{}/v1/stacks", app.base)).send().await.unwrap();
        if i == 0 {
            problem(answer, 501, "method_not_implemented").await;
        } else {
            assert_eq!(answer.status(), StatusCode::NOT_IMPLEMENTED);
        }
    }
    let text = pinstack::telemetry::recorder().unwrap().render();
    // the series are those of the process: other tests send odd methods to other routes
    let odd = "pinstack_http_requests_total{method=\"other\",route=\"/v1/stacks\"";
    let series: Vec<&str> = text.lines().filter(|line| line.starts_with(odd)).collect();
    assert_eq!(series.len(), 1, "{series:?}");
    assert!(!text.contains("ODD"), "a client's text is a label");
}

#[tokio::test]
async fn the_type_of_a_problem_is_a_url_that_explains_it() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let refused: Value = app.get("/v1/stacks").send().await.unwrap().json().await.unwrap();
    let kind = app.get(refused["type"].as_str().unwrap()).send().await.unwrap();
    assert_eq!(kind.status(), StatusCode::OK);
    let kind: Value = kind.json().await.unwrap();
    assert_eq!((&kind["code"], &kind["status"], &kind["title"]), (&refused["code"], &401.into(), &refused["title"]));
    for code in DOCUMENT.value()["components"]["schemas"]["Code"]["enum"].as_array().unwrap() {
        let path = format!("/problems/{}", code.as_str().unwrap());
        let kind: Value = app.get(&path).send().await.unwrap().json().await.unwrap();
        assert_eq!(kind["code"], *code, "{path}");
        assert!(kind["description"].as_str().is_some_and(|text| text.len() > 20), "{kind}");
    }
    problem(app.get("/problems/nothing").send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn the_root_page_asks_for_a_token_in_a_browser() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let page = app.get("/").header("accept", "text/html").send().await.unwrap();
    assert_eq!((page.status(), page.url().path()), (StatusCode::OK, "/sign-in"));
    assert_eq!(app.get("/favicon.ico").send().await.unwrap().status(), StatusCode::NO_CONTENT);
}

#[tokio::test]
async fn the_documentation_loads_nothing_from_other_servers() {
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
    let id = app.store.metadata.service_id().await.unwrap();
    assert_eq!(info["id"], id.to_string(), "clients know the service by it at every address");
    let served = app.get("/openapi.json").send().await.unwrap().text().await.unwrap();
    assert_eq!(served, DOCUMENT.text());
    let tag = app.get("/openapi.json").send().await.unwrap().headers()["etag"].clone();
    let again = app.get("/openapi.json").header("if-none-match", &tag).send().await.unwrap();
    assert_eq!((again.status(), &again.headers()["etag"]), (StatusCode::NOT_MODIFIED, &tag));
    assert_eq!(app.get("/healthz").send().await.unwrap().headers()["x-content-type-options"], "nosniff");
}

#[test]
fn the_committed_contract_is_the_one_that_is_served() {
    let committed = include_str!("../../openapi/openapi.json");
    let made = DOCUMENT.text();
    assert!(
        committed == made,
        "openapi/openapi.json has drifted; write it anew: cargo run -- openapi > openapi/openapi.json"
    );
}

#[test]
fn every_call_of_the_contract_is_documented_with_its_errors() {
    let document = DOCUMENT.value();
    for (path, method) in [
        ("/v1/profiles", "get"),
        ("/v1/profiles/{rig}/{lens}", "put"),
        ("/v1/profiles/{rig}/{lens}", "get"),
        ("/v1/profiles/{rig}/{lens}", "delete"),
        ("/v1/profiles/{rig}/{lens}/revisions", "get"),
        ("/v1/profiles/{rig}/{lens}/rig-parameters", "post"),
        ("/v1/profiles/{rig}/{lens}/camera", "post"),
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
        ("/v1/stacks/{id}/height", "get"),
        ("/v1/stacks/{id}/height-sigma", "get"),
        ("/v1/stacks/{id}/preview", "get"),
        ("/v1/stacks/{id}/metrics", "get"),
        ("/v1/stacks/{id}/cancel", "post"),
        ("/v1/stacks/{id}/rerun", "post"),
        ("/v1/stacks/{id}/upload", "get"),
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
        ("/problems/{code}", "get"),
    ] {
        let operation = &document["paths"][path][method];
        let responses = operation["responses"].as_object().unwrap_or_else(|| panic!("{method} {path} is missing"));
        for (status, response) in responses.iter().filter(|(status, _)| status.starts_with(['4', '5'])) {
            // sent by the HTTP library, before any code of the service
            if status == "431" {
                continue;
            }
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

/// The operations of the document: method, path, description.
fn operations(document: &Value) -> Vec<(&String, &String, &Value)> {
    let paths = document["paths"].as_object().unwrap().iter();
    paths.flat_map(|(path, item)| item.as_object().unwrap().iter().map(move |(m, o)| (m, path, o))).collect()
}

#[test]
fn every_refusal_names_its_codes_with_an_example_of_each() {
    let document = DOCUMENT.value();
    let examples = &document["components"]["examples"];
    for (method, path, operation) in operations(document) {
        for (status, response) in operation["responses"].as_object().unwrap() {
            let Some(told) = response["content"].get("application/problem+json") else { continue };
            // one schema for all, so that generated clients have one class of errors
            assert_eq!(told["schema"], json!({ "$ref": "#/components/schemas/Problem" }), "{method} {path} {status}");
            let named = told["examples"].as_object().unwrap();
            assert!(!named.is_empty(), "{method} {path} {status} names no code");
            for (code, example) in named {
                assert_eq!(example["$ref"], format!("#/components/examples/{code}"), "{method} {path} {status}");
                let example: pinstack::contract::Problem =
                    serde_json::from_value(examples[code]["value"].clone()).unwrap();
                assert_eq!(example.status.to_string(), *status, "{method} {path}: {code}");
            }
        }
    }
}

#[test]
fn every_code_can_be_found_in_the_document() {
    // codes that no operation returns itself: errors of jobs, and unknown methods
    const ELSEWHERE: [&str; 5] =
        ["target_not_found", "reconstruction_failed", "worker_lost", "method_not_allowed", "method_not_implemented"];
    let document = DOCUMENT.value();
    let codes = document["components"]["schemas"]["Code"]["enum"].as_array().unwrap();
    let all_operations = operations(document);
    for code in codes {
        let name = code.as_str().unwrap();
        let is_answered = all_operations.iter().any(|(_, _, operation)| {
            operation["responses"].as_object().unwrap().values().any(|response| {
                let told = &response["content"]["application/problem+json"]["examples"];
                told.get(name).is_some()
            })
        });
        assert_ne!(is_answered, ELSEWHERE.contains(&name), "{name}: is there an operation that answers it?");
        assert_eq!(is_answered, !document["components"]["examples"][name].is_null(), "{name}: an example that is used");
    }
}

#[test]
fn operation_ids_are_unique_and_parameters_are_never_null() {
    let document = DOCUMENT.value();
    let mut names: Vec<&str> = Vec::new();
    for (method, path, operation) in operations(document) {
        let name = operation["operationId"].as_str().unwrap();
        assert!(!names.contains(&name), "{method} {path}: {name} is another operation");
        names.push(name);
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            assert!(!parameter["schema"].to_string().contains("null"), "{method} {path}: {parameter}");
        }
    }
}

#[test]
fn generated_clients_find_what_they_need_in_the_document() {
    let document = DOCUMENT.value();
    assert_eq!(document["servers"][0]["url"], "/");
    let tags: Vec<&Value> = document["tags"].as_array().unwrap().iter().map(|tag| &tag["name"]).collect();
    for (method, path, operation) in operations(document) {
        let name = operation["operationId"].as_str().unwrap();
        let is_of_http = ["post_", "patch_", "head_", "options_"].iter().any(|verb| name.starts_with(verb));
        let is_verb_and_noun = name == "calibrate" || name.contains('_');
        assert!(is_verb_and_noun && !is_of_http, "{method} {path}: name it {name}? say what it does to what");
        assert!(name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{method} {path}: {name}");
        assert!(operation["description"].is_string(), "{name} has no description");
        assert!(operation["security"].is_array(), "{name} does not say whether it asks for a token");
        assert!(tags.contains(&&operation["tags"][0]), "{name} has a tag that the document does not describe");
        let responses = operation["responses"].as_object().unwrap();
        assert!(responses.keys().any(|status| status.starts_with('4')), "{name} is never refused");
        for content in responses.values().filter_map(|response| response["content"].as_object()) {
            let Some(stream) = content.get("text/event-stream") else { continue };
            assert_eq!(stream["schema"]["type"], "string", "{name}: an event stream is text");
        }
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            let has_form = operation["requestBody"]["content"].get("multipart/form-data").is_some();
            let is_required = has_form && parameter["required"] == true;
            assert!(!is_required || parameter["in"] != "query", "{name}: a form brings {} too", parameter["name"]);
        }
        let zips = operation["requestBody"]["content"].as_object();
        if let Some(zips) = zips.filter(|content| content.contains_key("application/zip")) {
            assert!(zips.contains_key("application/octet-stream"), "{name}: some generators know no other files");
        }
    }
    let form = &document["components"]["schemas"]["StackForm"];
    assert_eq!(form["required"], json!(["stack"]), "the rest can stand in the URL, or has a default");
}

#[test]
fn requests_and_responses_have_separate_option_schemas() {
    let schemas = &DOCUMENT.value()["components"]["schemas"];
    let shown = &schemas["StackOptions"];
    let names: Vec<&String> = shown["properties"].as_object().unwrap().keys().collect();
    assert_eq!(shown["required"], json!(names), "an answer shows all");
    for given in ["StackOptionsInput", "RerunOptions"] {
        let schema = &schemas[given];
        let given_names: Vec<&String> = schema["properties"].as_object().unwrap().keys().collect();
        assert_eq!((&given_names, schema.get("required")), (&names, None), "{given}: each may be left out");
        for (name, option) in schema["properties"].as_object().unwrap() {
            assert_eq!(option.get("default"), None, "{given}.{name}: clients would send it");
        }
        let r1 = &schema["properties"]["r1"];
        assert_eq!((&r1["minimum"], &r1["maximum"]), (&json!(1), &json!(200)), "{given}");
        assert!(r1["description"].as_str().unwrap().ends_with("Default: `45`."), "{r1}");
    }
    for (name, option) in schemas["RerunOptions"]["properties"].as_object().unwrap() {
        assert!(option.to_string().contains("\"null\""), "{name}: null gives it its default");
    }
}
