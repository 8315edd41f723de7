//! `GET /openapi.json`, and how the document is made.

use axum::{
    Extension,
    http::{HeaderMap, Method, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use utoipa::OpenApi;

use crate::{
    contract::{Code, Problem},
    http::{
        auth::needs,
        extract::conditional::{etag, not_modified},
        system::{examples, parameters, schemas},
    },
    store::{digest::hex, tokens::names},
};
use pinstack_science::types::error::ErrorLocation;

/// What no endpoint says by itself.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "pinstack",
        description = "Calibrated focus stacking for photogrammetry. Store or measure a profile (one homography per slice) \
            for a rig and a lens, send focus stacks as zips, get fused, masked images that are still perspective images.\n\n\
            Every error is `application/problem+json` with a stable `code`. Every answer carries `X-Request-Id`. Pixel \
            coordinates: x right, y down, the centre of the top-left pixel is (0, 0). A homography is row-major and maps \
            slice pixel to reference-slice pixel.\n\n\
            `Prefer: wait=N` lets a request wait for the end of a job: N seconds, at most 60. A larger N counts as 60, and \
            `Preference-Applied` says what was granted. A client that wants to wait longer asks again.\n\n\
            Each operation that needs a token names the scopes that allow it in `x-required-scopes`: one of them is enough. \
            The scope `admin` allows everything. A service may be set up to ask for no token.",
        contact(name = "The pinstack authors"),
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    servers((url = "/", description = "The service that sent this document")),
    tags(
        (name = "profiles", description = "One homography and one gain per slice, by rig and lens"),
        (name = "calibrations", description = "Profiles measured from a dot-target stack"),
        (name = "stacks", description = "Focus stacks, fused and masked"),
        (name = "uploads", description = "Stacks and dot targets sent in pieces: tus 1.0.0"),
        (name = "service", description = "The service about itself"),
    ),
    components(schemas(Problem, Code, ErrorLocation))
)]
pub struct Base;

/// The OpenAPI document, as a value and as the text that is committed and served.
#[derive(Debug)]
pub struct Document {
    value: Value,
    text: String,
    tag: String,
}

impl Document {
    /// Completes what the endpoints say of themselves.
    pub fn of(api: utoipa::openapi::OpenApi) -> Self {
        let value = completed(serde_json::to_value(api).unwrap_or_default());
        let mut text = serde_json::to_string_pretty(&value).unwrap_or_default();
        text.push('\n');
        let tag = hex(&Sha256::digest(&text));
        Self { value, text, tag }
    }

    /// The document as JSON.
    pub fn value(&self) -> &Value {
        &self.value
    }

    /// The document as it is committed and served.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// Read the contract
///
/// This document. It is the same until the service is replaced by another version.
#[utoipa::path(
    get,
    path = "/openapi.json",
    operation_id = "get_openapi",
    tag = "service",
    params(("If-None-Match" = Option<String>, Header, description = "`ETag` of what the client has")),
    responses(
        (status = 200, description = "OpenAPI 3.1", body = Object, content_type = "application/json", headers(
            ("ETag" = String, description = "SHA-256 of the document"))),
        (status = 304, description = "The client has it already"),
    )
)]
pub async fn openapi(Extension(document): Extension<&'static Document>, headers: HeaderMap) -> Response {
    let tag = [(header::ETAG, etag(&document.tag))];
    if not_modified(&headers, &document.tag) {
        return (StatusCode::NOT_MODIFIED, tag).into_response();
    }
    (tag, [(header::CONTENT_TYPE, "application/json")], document.text()).into_response()
}

/// Adds what is the same everywhere, so that endpoints only say what is their own: errors are problems with the codes
/// that their descriptions name, anything can fail with 500, and every answer carries a request id.
fn completed(mut document: Value) -> Value {
    schemas::complete(&mut document);
    uploads_by_put(&mut document);
    let examples = examples::all(&document);
    let option_schemas = document["components"]["schemas"].clone();
    for (path, item) in document["paths"].as_object_mut().into_iter().flatten() {
        for (method, operation) in item.as_object_mut().into_iter().flatten() {
            protect(path, method, operation);
            complete(&examples, method, operation);
            parameters::add_options(operation, &option_schemas);
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
    document["components"]["examples"] = examples.used_in(&document);
    document["components"]["securitySchemes"]["token"] = json!({
        "type": "http", "scheme": "bearer",
        "description": "A token made by `pinstack token add`. A service may be set up to ask for none."
    });
    document
}

/// Files are taken by PUT too, because `curl -T` sends them so.
fn uploads_by_put(document: &mut Value) {
    for path in ["/v1/stacks", "/v1/profiles/{rig}/{lens}/calibrations", "/v1/profiles/{rig}/{lens}/import"] {
        let mut by_put = document["paths"][path]["post"].clone();
        for (member, suffix) in [("summary", " by PUT"), ("operationId", "_by_put")] {
            by_put[member] = json!(format!("{}{suffix}", by_put[member].as_str().unwrap_or_default()));
        }
        document["paths"][path]["put"] = by_put;
    }
    // the body of a new upload may be its first piece, or nothing; that of a rerun names what is different
    for path in ["/v1/uploads", "/v1/stacks/{id}/rerun"] {
        document["paths"][path]["post"]["requestBody"]["required"] = json!(false);
    }
}

/// What the table of scopes says about an operation.
fn protect(path: &str, method: &str, operation: &mut Value) {
    let method = Method::from_bytes(method.to_uppercase().as_bytes()).unwrap_or_default();
    let Some(scopes) = needs(&method, path) else {
        operation["security"] = json!([]);
        return;
    };
    operation["security"] = json!([{ "token": [] }]);
    operation["x-required-scopes"] = scopes.iter().map(|scope| scope.as_str()).collect();
    operation["responses"]["401"] =
        json!({ "description": "`unauthorized`: a token is asked for, and there was no valid one" });
    let scopes = names(scopes, "` or `");
    let foreign = if method.is_safe() { "" } else { "; `cross_origin_request`: a page of another origin sent it" };
    operation["responses"]["403"] =
        json!({ "description": format!("`forbidden`: the token does not allow `{scopes}`{foreign}") });
    operation["responses"]["429"] = json!({ "description": "`too_many_requests`: the token has too many requests in progress; with `Retry-After`" });
}

/// What every operation can answer, and what belongs to every answer.
fn complete(examples: &examples::Examples, method: &str, operation: &mut Value) {
    let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) else { return };
    let misdirected = "`misdirected_request`: `Host` is no name of this service, which asks for no token";
    responses.entry("421").or_insert_with(|| json!({ "description": misdirected }));
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
            let description = response["description"].as_str().unwrap_or_default();
            response["content"] = examples.content(description, status);
        }
    }
}
