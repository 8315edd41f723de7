//! `GET /openapi.json`, and how the document is made.

use axum::{
    http::{Method, header},
    response::{IntoResponse, Response},
};
use serde_json::{Value, json};
use utoipa::OpenApi;

use crate::{
    http::{auth::needs, problem::PROBLEM_JSON, router},
    model::{Code, Problem, error::FaultPlace},
    store::tokens::names,
};

/// What no endpoint says by itself.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "pinstack",
        description = "Calibrated focus stacking for photogrammetry. Store or measure a profile (one homography per slice) \
            for a rig and a lens, send focus stacks as zips, get fused, masked images that are still perspective images.\n\n\
            Every error is `application/problem+json` with a stable `code`. Every answer carries `X-Request-Id`. Pixel \
            coordinates: x right, y down, the centre of the top-left pixel is (0, 0). A homography is row-major and maps \
            slice pixel to reference-slice pixel.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    tags(
        (name = "profiles", description = "One homography and one gain per slice, by rig and lens"),
        (name = "calibrations", description = "Profiles measured from a dot-target stack"),
        (name = "stacks", description = "Focus stacks, fused and masked"),
        (name = "uploads", description = "Stacks and dot targets sent in pieces: tus 1.0.0"),
        (name = "service", description = "The service about itself"),
    ),
    components(schemas(Problem, Code, FaultPlace))
)]
pub struct Base;

/// The contract
///
/// This document.
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "service",
    responses((status = 200, description = "OpenAPI 3.1", body = Object, content_type = "application/json"))
)]
pub async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], text()).into_response()
}

/// The document as it is committed and served.
pub fn text() -> String {
    let mut text = serde_json::to_string_pretty(&document()).unwrap_or_default();
    text.push('\n');
    text
}

/// The document. What is the same everywhere is added here, so that endpoints only say what is their own: errors are
/// problems, anything can fail with 500, and every answer carries a request id.
pub fn document() -> Value {
    let (_, document) = router::routes().split_for_parts();
    let mut document = serde_json::to_value(document).unwrap_or_default();
    let Some(paths) = document["paths"].as_object_mut() else { return document };
    for (path, item) in paths.iter_mut() {
        let Some(operations) = item.as_object_mut() else { continue };
        for (method, operation) in operations.iter_mut() {
            protect(path, method, operation);
        }
    }
    for operation in paths.values_mut().filter_map(Value::as_object_mut).flat_map(|item| item.values_mut()) {
        let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) else { continue };
        responses.entry("500").or_insert_with(|| json!({ "description": "`internal`: our own fault" }));
        for (status, response) in responses.iter_mut() {
            complete(status, response);
        }
    }
    document["components"]["securitySchemes"]["token"] = json!({
        "type": "http", "scheme": "bearer",
        "description": "A token made by `pinstack token add`. A service may be set up to ask for none."
    });
    document
}

/// What the table of scopes says about an operation.
fn protect(path: &str, method: &str, operation: &mut Value) {
    let method = Method::from_bytes(method.to_uppercase().as_bytes()).unwrap_or_default();
    let Some(scopes) = needs(&method, path) else { return };
    operation["security"] = scopes.iter().map(|scope| json!({ "token": [scope.as_str()] })).collect();
    operation["responses"]["401"] =
        json!({ "description": "`unauthorized`: a token is asked for, and there was no valid one" });
    let scopes = names(scopes, "` or `");
    operation["responses"]["403"] =
        json!({ "description": format!("`forbidden`: the token does not allow `{scopes}`") });
}

fn complete(status: &str, response: &mut Value) {
    response["headers"]["X-Request-Id"] = json!({
        "description": "The client's own, or one that was made", "schema": { "type": "string" }
    });
    let is_error = status.starts_with('4') || status.starts_with('5');
    if is_error && response.get("content").is_none() {
        response["content"] = json!({ PROBLEM_JSON: { "schema": { "$ref": "#/components/schemas/Problem" } } });
    }
}
