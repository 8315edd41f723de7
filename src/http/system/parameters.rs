//! Parameters in the OpenAPI document: the options as query parameters, and the schema of each parameter by its name
//! (range, pattern). The ranges of options come from [`crate::contract::ranges`].

use serde_json::{Value, json};

use crate::contract::ranges::{self, Range};

/// Base64 of 20 bytes (SHA-1) and of 32 bytes (SHA-256). The unused bits of the last digit must be zero.
const CHECKSUM: &str = "^(sha1 [A-Za-z0-9+/]{26}[AEIMQUYcgkosw048]=|sha256 [A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=)$";

/// Media types of binary bodies.
const FILES: [&str; 6] = [
    "application/pdf",
    "application/zip",
    "application/x-npy",
    "application/x-npz",
    "application/octet-stream",
    "application/offset+octet-stream",
];

const NUMBERS: &str = r"^-?[0-9]{1,6}(\.[0-9]{1,6})?(,-?[0-9]{1,6}(\.[0-9]{1,6})?)*$";

/// The operations that take options as query parameters, and the schema of the options. The descriptions of the
/// parameters are those of the schema.
const OPERATIONS_WITH_OPTIONS: [(&str, &str); 6] = [
    ("send_stack", "StackOptionsInput"),
    ("send_stack_by_put", "StackOptionsInput"),
    ("send_scan", "StackOptionsInput"),
    ("send_scan_by_put", "StackOptionsInput"),
    ("calibrate", "CalibrationOptions"),
    ("calibrate_by_put", "CalibrationOptions"),
];

/// Adds the options of an operation as query parameters, after those of its own and before its headers.
pub fn add_options(operation: &mut Value, schemas: &Value) {
    let id = operation["operationId"].as_str().unwrap_or_default();
    let Some((_, options)) = OPERATIONS_WITH_OPTIONS.iter().find(|(operation, _)| *operation == id) else { return };
    let properties = schemas[options]["properties"].as_object();
    let options = properties.into_iter().flatten().map(|(name, property)| query_parameter(name, property));
    let Some(parameters) = operation.get_mut("parameters").and_then(Value::as_array_mut) else { return };
    let end = parameters.iter().position(|parameter| parameter["in"] == "header").unwrap_or(parameters.len());
    parameters.splice(end..end, options);
}

/// An option as a query parameter. A list is written with commas.
fn query_parameter(name: &str, property: &Value) -> Value {
    // an optional enumeration is a choice between a reference and null
    let choices = property["oneOf"].as_array().into_iter().flatten();
    let property = choices.into_iter().find(|choice| choice.get("$ref").is_some()).unwrap_or(property);
    let mut schema = json!({});
    for member in ["$ref", "type", "format"] {
        if let Some(value) = property.get(member) {
            schema[member] = value.clone();
        }
    }
    let mut description = property["description"].as_str().unwrap_or_default().replace('\n', " ");
    if property.get("items").is_some() {
        schema = json!({ "type": "string" });
        description.push_str(" In the URL: numbers separated by commas.");
    }
    json!({ "name": name, "in": "query", "required": false, "description": description, "schema": schema })
}

/// Completes the parameters of an operation with what their names imply.
pub fn complete(operation: &mut Value) {
    let Some(Value::Array(parameters)) = operation.get_mut("parameters") else { return };
    for parameter in parameters {
        let name = parameter["name"].as_str().unwrap_or_default().to_owned();
        let schema = &mut parameter["schema"];
        if let Some(precise) = precise(&name) {
            *schema = precise;
        }
        // a parameter is absent rather than null
        if let Some(kinds) = schema["type"].as_array() {
            let kind = kinds.iter().find(|kind| *kind != "null").cloned();
            schema["type"] = kind.unwrap_or(Value::Null);
        }
    }
}

/// The schema of all parameters of this name, where it is more than a type.
pub(super) fn precise(name: &str) -> Option<Value> {
    let whole = |least: u64, most: u64| json!({ "type": "integer", "minimum": least, "maximum": most });
    let text = |pattern: &str| json!({ "type": "string", "pattern": pattern });
    Some(match name {
        "rig" | "lens" | "scan" => json!({ "$ref": "#/components/schemas/Name" }),
        "id" => json!({ "type": "string", "format": "uuid" }),
        // lists
        "limit" => json!({ "type": "integer", "minimum": 1, "maximum": 500, "default": 50 }),
        // sizes and numbers of slices
        "image_width" | "image_height" => whole(16, 65_535),
        "reference_index" | "slice" => whole(0, 999),
        "revision" | "profile_revision" | "from" | "to" => whole(1, u64::from(u32::MAX)),
        // options of a stack
        "mask_threshold" => text(r"^(auto|0(\.[0-9]{1,9})?|1(\.0{1,9})?)$"),
        "mask_min_blob_px" | "mask_min_hole_px" => whole(0, u64::from(u32::MAX)),
        "bit_depth" => json!({ "type": "string", "enum": ["auto", "8", "16"] }),
        "input_bits" => json!({ "type": "string", "enum": ["auto", "10", "12", "14", "16"] }),
        "crop" => text("^(none|valid|[0-9]{1,5},[0-9]{1,5},[1-9][0-9]{0,4},[1-9][0-9]{0,4})$"),
        // numbers separated by commas
        "rail_positions_mm" => text(NUMBERS),
        // headers
        "Idempotency-Key" => text("^[!-~]([ -~]{0,253}[!-~])?$"),
        "Tus-Resumable" => json!({ "type": "string", "enum": ["1.0.0"] }),
        "Upload-Length" => json!({ "type": "integer", "format": "int64", "minimum": 1 }),
        "Upload-Checksum" => text(CHECKSUM),
        option => match ranges::of(option)? {
            Range::Whole(least, most) => whole(least.into(), most.into()),
            Range::Odd(least, most) => {
                json!({ "type": "integer", "minimum": least, "maximum": most, "not": { "multipleOf": 2 } })
            }
            Range::Number(least, most) => json!({ "type": "number", "minimum": least, "maximum": most }),
            Range::Characters(most) => json!({ "type": "string", "maxLength": most }),
            // JSON Schema has no range with a gap
            Range::Magnitude(..) => return None,
        },
    })
}

/// Describes binary bodies as such (utoipa describes them as lists of numbers) and the events of a stream.
pub fn complete_contents(content: &mut Value) {
    for (kind, body) in content.as_object_mut().into_iter().flatten() {
        if kind.starts_with("image/") || FILES.contains(&kind.as_str()) {
            body["schema"] = json!({ "type": "string", "format": "binary" });
        }
        if kind == "text/event-stream" {
            body["schema"] = json!({
                "type": "string",
                "description": "Server-sent events. `event` is `state` (data: the job as JSON) or `progress` (data: its \
                    progress as JSON); `id` is the version of the job, for `Last-Event-ID`."
            });
        }
    }
}
