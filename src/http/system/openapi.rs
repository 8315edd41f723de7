//! `GET /openapi.json`, and how the document is made.

use axum::{
    http::{Method, header},
    response::{IntoResponse, Response},
};
use serde_json::{Value, json};
use utoipa::OpenApi;

use crate::{
    http::{
        auth::needs,
        router,
        system::{examples, parameters},
    },
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
/// problems with the codes that their descriptions name, anything can fail with 500, and every answer carries a request id.
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
    uploads_by_put(&mut document);
    examples::add(&mut document);
    let known = document.clone();
    let Some(paths) = document["paths"].as_object_mut() else { return known };
    for (path, item) in paths.iter_mut() {
        for (method, operation) in item.as_object_mut().into_iter().flatten() {
            operation["operationId"] = json!(operation_id(method, path));
            complete(&known, method, operation);
            parameters::complete(operation);
            if let Some(content) = operation.pointer_mut("/requestBody/content") {
                parameters::complete_contents(content);
            }
            let responses = operation.get_mut("responses").and_then(Value::as_object_mut);
            let contents =
                responses.into_iter().flat_map(|all| all.values_mut()).filter_map(|one| one.get_mut("content"));
            contents.for_each(parameters::complete_contents);
        }
    }
    document["components"]["securitySchemes"]["token"] = json!({
        "type": "http", "scheme": "bearer",
        "description": "A token made by `pinstack token add`. A service may be set up to ask for none."
    });
    document
}

/// A name for programs that are made from the document: unique, and told by the call alone.
fn operation_id(method: &str, path: &str) -> String {
    let words = path.trim_start_matches("/v1").replace(['{', '}'], "").replace(['/', '-', '.'], "_");
    format!("{method}{words}")
}

/// Files are taken by PUT too, because `curl -T` sends them so.
fn uploads_by_put(document: &mut Value) {
    for path in ["/v1/stacks", "/v1/profiles/{rig}/{lens}/calibrations", "/v1/profiles/{rig}/{lens}/import"] {
        let mut by_put = document["paths"][path]["post"].clone();
        by_put["summary"] = json!(format!("{} by PUT", by_put["summary"].as_str().unwrap_or_default()));
        document["paths"][path]["put"] = by_put;
    }
    // the body of a new upload may be its first piece, or nothing
    document["paths"]["/v1/uploads"]["post"]["requestBody"]["required"] = json!(false);
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

/// What every operation can answer, and what belongs to every answer.
fn complete(document: &Value, method: &str, operation: &mut Value) {
    let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) else { return };
    responses.entry("500").or_insert_with(|| json!({ "description": "`internal`: our own fault" }));
    if ["put", "post", "patch", "delete"].contains(&method) {
        let full = "`insufficient_storage`: the disk of the server is full";
        responses.entry("507").or_insert_with(|| json!({ "description": full }));
    }
    for (status, response) in responses.iter_mut() {
        response["headers"]["X-Request-Id"] = json!({
            "description": "The client's own, or one that was made", "schema": { "type": "string" }
        });
        let is_error = status.starts_with('4') || status.starts_with('5');
        if is_error && response.get("content").is_none() {
            let codes = examples::named(document, response["description"].as_str().unwrap_or_default(), status);
            response["content"] = examples::content(&codes, status);
        }
    }
}
