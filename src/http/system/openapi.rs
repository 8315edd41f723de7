//! `GET /openapi.json`, and the completion of the document that utoipa generates.

use std::borrow::Cow;

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
        calibrations::stored::StoredStacks,
        extract::{etag, not_modified},
        links,
        system::{examples, parameters, schemas},
    },
    store::{digest::hex, tokens::names},
};
use pinstack_science::types::error::ErrorLocation;

/// The parts of the document that belong to no endpoint.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "pinstack",
        description = "Calibrated focus stacking for photogrammetry. Store or measure a profile (one homography per slice) \
            for a rig and a lens, send focus stacks as zips, and get fused, masked images with the geometry of a pinhole \
            camera.\n\n\
            **Errors.** Every error is `application/problem+json` (RFC 9457) with a stable `code`. Every answer has an \
            `X-Request-Id`.\n\n\
            **Coordinates.** Pixels: x to the right, y down, the centre of the top-left pixel is (0, 0). A homography is \
            row-major and maps pixels of a slice to pixels of the reference slice.\n\n\
            **Waiting.** With `Prefer: wait=N` a request waits up to N seconds, at most 50, for the end of a job. \
            `Preference-Applied` has the granted time. To wait longer, repeat the request.\n\n\
            **Access.** `x-required-scopes` of an operation lists the scopes of which a token needs one. The scope `admin` \
            allows everything. A service can be configured to require no token.",
        contact(name = "The pinstack authors"),
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    servers((url = "/", description = "The service that sent this document")),
    tags(
        (name = "profiles", description = "One homography and one gain per slice, for each rig and lens"),
        (name = "calibrations", description = "Profiles measured from a dot-target stack"),
        (name = "stacks", description = "Focus stacks: upload, fusion, results"),
        (name = "scans", description = "Many views of one object: table, upload in one zip, bundles for reconstruction programs"),
        (name = "reconstructions", description = "Scans reconstructed by COLMAP: cameras, points, findings"),
        (name = "optics", description = "Planning a capture, and printable dot targets"),
        (name = "uploads", description = "Resumable uploads of stacks, dot targets and scans: tus 1.0.0"),
        (name = "service", description = "Health, limits, metrics and documentation of the service"),
    ),
    components(schemas(Problem, Code, ErrorLocation, StoredStacks))
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
    /// Completes the generated document.
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

/// Get the OpenAPI document
///
/// This document. It changes only with the version of the service.
#[utoipa::path(
    get,
    path = "/openapi.json",
    operation_id = "get_openapi",
    tag = "service",
    params(("If-None-Match" = Option<String>, Header, description = "`ETag` of the version that the client has")),
    responses(
        (status = 200, description = "OpenAPI 3.1", body = Object, content_type = "application/json", headers(
            ("ETag" = String, description = "SHA-256 of the document"))),
        (status = 304, description = "The client has this version already"),
    )
)]
pub async fn openapi(Extension(document): Extension<&'static Document>, headers: HeaderMap) -> Response {
    let (mut text, mut digest) = (Cow::Borrowed(document.text()), Cow::Borrowed(document.tag.as_str()));
    if !links::prefix().is_empty() {
        text = text.replacen(&server("/"), &server(&link!("/")), 1).into();
        digest = hex(&Sha256::digest(text.as_bytes())).into();
    }
    let tag = [(header::ETAG, etag(&digest))];
    if not_modified(&headers, &digest) {
        return (StatusCode::NOT_MODIFIED, tag).into_response();
    }
    (tag, [(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// The URL of the server, as the document has it.
fn server(url: &str) -> String {
    format!("\"url\": \"{url}\"")
}

/// Adds what all operations have in common, so that endpoints document only their own: problem bodies with examples of
/// the codes that their descriptions name, common errors, the request id, and the needed scopes.
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
        "description": "A token made by `pinstack token add`. A service can be configured to require none."
    });
    document
}

/// Documents PUT for the operations that accept files, because `curl -T` sends PUT.
fn uploads_by_put(document: &mut Value) {
    for path in [
        "/v1/stacks",
        "/v1/scans/{scan}/archive",
        "/v1/profiles/{rig}/{lens}/calibrations",
        "/v1/profiles/{rig}/{lens}/import",
    ] {
        let mut by_put = document["paths"][path]["post"].clone();
        for (member, suffix) in [("summary", " by PUT"), ("operationId", "_by_put")] {
            by_put[member] = json!(format!("{}{suffix}", by_put[member].as_str().unwrap_or_default()));
        }
        document["paths"][path]["put"] = by_put;
    }
    // optional bodies: the first bytes of a new upload, the changed options of a rerun
    for path in ["/v1/uploads", "/v1/stacks/{id}/rerun", "/v1/scans/{scan}/rerun", "/v1/scans/{scan}/reconstructions"] {
        document["paths"][path]["post"]["requestBody"]["required"] = json!(false);
    }
}

/// Adds the needed scopes of an operation, and the errors of missing rights.
fn protect(path: &str, method: &str, operation: &mut Value) {
    let method = Method::from_bytes(method.to_uppercase().as_bytes()).unwrap_or_default();
    let Some(scopes) = needs(&method, path) else {
        operation["security"] = json!([]);
        return;
    };
    operation["security"] = json!([{ "token": [] }]);
    operation["x-required-scopes"] = scopes.iter().map(|scope| scope.as_str()).collect();
    operation["responses"]["401"] =
        json!({ "description": "`unauthorized`: the request needs a token and has no valid one" });
    let scopes = names(scopes, "` or `");
    let foreign = if method.is_safe() { "" } else { "; `cross_origin_request`: a page of another origin sent it" };
    operation["responses"]["403"] =
        json!({ "description": format!("`forbidden`: the token does not allow `{scopes}`{foreign}") });
    operation["responses"]["429"] = json!({ "description": "`too_many_requests`: the token has too many requests in progress; with `Retry-After`" });
}

/// Adds the errors that every operation can answer, and the header of every answer.
fn complete(examples: &examples::Examples, method: &str, operation: &mut Value) {
    let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) else { return };
    let misdirected = "`misdirected_request`: `Host` is not a name of this service, which requires no token";
    responses.entry("421").or_insert_with(|| json!({ "description": misdirected }));
    responses.entry("500").or_insert_with(|| json!({ "description": "`internal`: an error of the service" }));
    if ["put", "post", "patch", "delete"].contains(&method) {
        let full = "`insufficient_storage`: the disk of the server is full";
        responses.entry("507").or_insert_with(|| json!({ "description": full }));
    }
    for (status, response) in responses.iter_mut() {
        response["headers"]["X-Request-Id"] = json!({
            "description": "The id from the request, or a generated one", "schema": { "type": "string" }
        });
        let is_error = status.starts_with('4') || status.starts_with('5');
        if is_error && response.get("content").is_none() {
            let description = response["description"].as_str().unwrap_or_default();
            response["content"] = examples.content(description, status);
        }
    }
}
