//! One problem of each code, as the document shows it.

use serde_json::{Map, Value, json};

use crate::{
    http::problem::{PROBLEM_JSON, code_name, problem, status},
    model::{Code, Fault},
};

/// Something that was really said under this code.
fn sentence(code: Code) -> &'static str {
    match code {
        Code::InvalidRequest => "mask is 'maybe'; it must be one of: auto, none, required",
        Code::Unauthorized => {
            "this service asks for a token: send Authorization: Bearer <token>, with one that was made by 'pinstack token add' \
             and not revoked"
        }
        Code::Forbidden => "the token 'viewer' allows: read; this request needs: stacks:write",
        Code::NotFound => "there is nothing with the id 0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10",
        Code::MethodNotAllowed => "POST is not allowed on /healthz; the Allow header names what is",
        Code::ProfileNotFound => {
            "there is no profile for rig 'turntable-1' and lens 'mpe65-2x'; GET /v1/profiles lists all"
        }
        Code::NotFinished => "the job is running; its result exists when it has succeeded",
        Code::NoResult => "the stack has no back light, so it has no mask",
        Code::Conflict => "the stack has succeeded already, so it cannot be cancelled",
        Code::PreconditionFailed => "the profile is at revision 4 now; read it again and decide",
        Code::IdempotencyKeyReused => {
            "the Idempotency-Key 'bee-17' was used before with another rig, lens, options or file; use a new key per stack"
        }
        Code::UnsupportedMediaType => {
            "the body is 'image/jpeg'; send the zip as application/zip, or multipart/form-data"
        }
        Code::NotAcceptable => "the image can be had as image/png or image/tiff",
        Code::RangeNotSatisfiable => "the range begins behind the end of the file (48210 bytes)",
        Code::UploadTooLarge => "the upload is over the limit of 68719476736 bytes; GET /v1/info shows every limit",
        Code::UploadIncomplete => "the upload broke off before its end; nothing was stored; send it again",
        Code::ChecksumMismatch => {
            "the bytes of this request are not those of its Upload-Checksum; none of them were kept, send them again from the \
             same offset"
        }
        Code::Locked => "another request holds the upload and does not let go; try again in a second",
        Code::InsufficientStorage => {
            "no room for this upload: it needs 4100000000 bytes, 3900000000 are free, of which 0 are promised to uploads in \
             progress and 536870912 must stay free; delete old stacks or enlarge the disk"
        }
        Code::QueueFull => "1000 jobs wait already; try again later",
        Code::InvalidArchive => {
            "front/img_3.jpg is damaged in the zip (Invalid checksum); was the upload cut off? Make the zip again and send it \
             again"
        }
        Code::UnsupportedArchive => "front/img_0.jpg is encrypted; make the zip without a password",
        Code::ArchiveTooLarge => "the zip has 30000 members; at most 2500 are read",
        Code::InvalidImage => {
            "front/img_3.jpg: the JPEG ends before the picture does (torn file); copy it again from the camera"
        }
        Code::SizeMismatch => {
            "the slices have 6000 x 4000 px, the profile of rig 'turntable-1' and lens 'mpe65-2x' (revision 3) is for 5760 x \
             3840 px"
        }
        Code::SliceCountMismatch => {
            "the archive has 20 front-light slices, the profile of rig 'turntable-1' and lens 'mpe65-2x' (revision 3) has 21"
        }
        Code::InvalidProfile => "the homography of slice 3 is mirrored",
        Code::TargetNotFound => "no grid of dots was found in 3 of 21 slices: img_0.jpg, img_1.jpg, img_20.jpg",
        Code::MaskFailed => "mask=required, but the archive has no back-light slices; put them into a folder 'back'",
        Code::WorkerLost => "the worker died on this job 3 times; it was given up",
        Code::Unavailable => "the server goes down; what arrived is safe, go on when it is back",
        Code::Internal => {
            "something went wrong on the server; the request id in X-Request-Id finds the details in its log"
        }
    }
}

/// Every code, by its name in the document.
fn codes(document: &Value) -> Vec<Code> {
    let names = document["components"]["schemas"]["Code"]["enum"].as_array();
    names.into_iter().flatten().filter_map(|name| serde_json::from_value(name.clone()).ok()).collect()
}

/// Adds an example of each code to the components.
pub fn add(document: &mut Value) {
    let examples: Map<String, Value> = codes(document)
        .into_iter()
        .map(|code| {
            let told = problem(&Fault::new(code, sentence(code)), Some("/v1/stacks".to_owned()));
            (code_name(code), json!({ "summary": told.title, "value": told }))
        })
        .collect();
    document["components"]["examples"] = Value::Object(examples);
}

/// The codes that the description of an answer names, of those that have its status.
pub fn named(document: &Value, description: &str, answered: &str) -> Vec<Code> {
    let is_named = |code: &Code| description.contains(&format!("`{}`", code_name(*code)));
    let fits = |code: &Code| status(*code).as_str() == answered;
    codes(document).into_iter().filter(|code| fits(code) && is_named(code)).collect()
}

/// The content of an answer that is a problem with one of these codes.
pub fn content(codes: &[Code], answered: &str) -> Value {
    let names: Vec<String> = codes.iter().map(|code| code_name(*code)).collect();
    let examples: Map<String, Value> =
        names.iter().map(|name| (name.clone(), json!({ "$ref": format!("#/components/examples/{name}") }))).collect();
    let narrowed = json!({ "properties": {
        "status": { "const": answered.parse::<u16>().unwrap_or_default() },
        "code": { "enum": names }
    } });
    json!({ PROBLEM_JSON: {
        "schema": { "allOf": [{ "$ref": "#/components/schemas/Problem" }, narrowed] },
        "examples": examples
    } })
}
