//! What the document says of parameters beyond their type: names, ranges and forms, each once.

use serde_json::{Value, json};

/// Base64 of 20 (SHA-1) and of 32 bytes (SHA-256): the last digit has bits that must be zero.
const CHECKSUM: &str = "^(sha1 [A-Za-z0-9+/]{26}[AEIMQUYcgkosw048]=|sha256 [A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=)$";

/// Kinds of body that are bytes.
const FILES: [&str; 5] = [
    "application/zip",
    "application/x-npy",
    "application/x-npz",
    "application/octet-stream",
    "application/offset+octet-stream",
];

const NUMBERS: &str = r"^-?[0-9]{1,6}(\.[0-9]{1,6})?(,-?[0-9]{1,6}(\.[0-9]{1,6})?)*$";

/// Makes the parameters of an operation say what they must be.
pub fn complete(operation: &mut Value) {
    let Some(Value::Array(parameters)) = operation.get_mut("parameters") else { return };
    for parameter in parameters {
        let name = parameter["name"].as_str().unwrap_or_default().to_owned();
        let schema = &mut parameter["schema"];
        if let Some(precise) = precise(&name) {
            *schema = precise;
        }
        // a parameter is there or not; only JSON knows null
        if let Some(kinds) = schema["type"].as_array() {
            let kind = kinds.iter().find(|kind| *kind != "null").cloned();
            schema["type"] = kind.unwrap_or(Value::Null);
        }
    }
}

/// The schema of every parameter of this name that is more than a type.
pub(super) fn precise(name: &str) -> Option<Value> {
    let whole = |least: u64, most: u64| json!({ "type": "integer", "minimum": least, "maximum": most });
    let number = |least: f64, most: f64| json!({ "type": "number", "minimum": least, "maximum": most });
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
        "jpeg_quality" => whole(1, 100),
        "bit_depth" => json!({ "type": "string", "enum": ["auto", "8", "16"] }),
        "input_bits" => json!({ "type": "string", "enum": ["auto", "10", "12", "14", "16"] }),
        "crop" => text("^(none|valid|[0-9]{1,5},[0-9]{1,5},[1-9][0-9]{0,4},[1-9][0-9]{0,4})$"),
        "r1" | "r2" => whole(1, 200),
        "eps1" | "eps2" => number(1e-9, 10.0),
        "average" => json!({ "type": "integer", "minimum": 3, "maximum": 201, "not": { "multipleOf": 2 } }),
        "r_g" => whole(1, 20),
        "sigma_g" => number(0.1, 50.0),
        "label" => json!({ "type": "string", "maxLength": 200 }),
        "pan_deg" => number(-3600.0, 3600.0),
        "tilt_deg" => number(-360.0, 360.0),
        "keep_days" => whole(1, 36_500),
        // options of a calibration, and of matrices
        "target_pitch_mm" => number(1e-4, 1000.0),
        "pixel_pitch_mm" => number(1e-5, 1.0),
        "focal_mm" => number(0.1, 10_000.0),
        "rail_positions_mm" => text(NUMBERS),
        "note" => json!({ "type": "string", "maxLength": 4000 }),
        // headers
        "Idempotency-Key" => text("^[!-~]([ -~]{0,253}[!-~])?$"),
        "Tus-Resumable" => json!({ "type": "string", "enum": ["1.0.0"] }),
        "Upload-Length" => json!({ "type": "integer", "format": "int64", "minimum": 1 }),
        "Upload-Checksum" => text(CHECKSUM),
        _ => return None,
    })
}

/// Bytes are no list of numbers.
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
