//! One problem of each code, as the document shows it.

use serde_json::{Map, Value, json};

use crate::{
    contract::{Code, Fault},
    http::problem::{PROBLEM_JSON, code_name, problem, status},
};

/// Something that was really said under this code.
pub fn sentence(code: Code) -> &'static str {
    match code {
        Code::InvalidRequest => "mask is 'maybe'; it must be one of: auto, none, required",
        Code::Unauthorized => {
            "this service asks for a token: send Authorization: Bearer <token>, with one that was made by 'pinstack token add' \
             and not revoked"
        }
        Code::Forbidden => "the token 'viewer' allows: read; this request needs: stacks:write",
        Code::CrossOriginRequest => {
            "a page of https://other.example sent this request; the service asks for no token, so it takes changes only from \
             its own pages and from programs; to allow the origin, add it to cors_origins"
        }
        Code::MisdirectedRequest => {
            "the request is for the host 'other.example', which is no name of this service; use its address, or add the name \
             to the setting 'hosts' (PINSTACK_HOSTS)"
        }
        Code::TooManyRequests => {
            "the token 'rig-pc' has 256 requests in progress, which is all it may have; wait until one has ended"
        }
        Code::NotFound => "there is nothing with the id 0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10",
        Code::MethodNotAllowed => "POST is not allowed on /healthz; the Allow header names what is",
        Code::MethodNotImplemented => "'FETCH' is no method of HTTP that this service knows",
        Code::ProfileNotFound => {
            "there is no profile for rig 'turntable-1' and lens 'mpe65-2x'; GET /v1/profiles lists all"
        }
        Code::NotFinished => "the job is running; its result exists when it has succeeded",
        Code::NoResult => "the stack has no back light, so it has no mask",
        Code::UploadRemoved => {
            "the zip of this stack was removed because its time was over (keep_uploads_days of the server); its results are \
             there; send the zip again for another result"
        }
        Code::Conflict => "the stack has succeeded already, so it cannot be cancelled",
        Code::PreconditionFailed => "the profile is at revision 4 now; read it again and decide",
        Code::IdempotencyKeyReused => {
            "the Idempotency-Key 'bee-17' was used before with another rig, lens, options or file; use a new key per stack"
        }
        Code::UnsupportedMediaType => {
            "the body is 'image/jpeg'; send the zip as application/zip, or multipart/form-data"
        }
        Code::NotAcceptable => "the report can be had as text/html or application/json",
        Code::RangeNotSatisfiable => "the range begins behind the end of the file (48210 bytes)",
        Code::UploadTooLarge => "the upload is over the limit of 68719476736 bytes; GET /v1/info shows every limit",
        Code::UploadIncomplete => "the upload broke off before its end; nothing was stored; send it again",
        Code::ChecksumMismatch => {
            "the bytes of this request are not those of its Upload-Checksum; none of them were kept, send them again from the \
             same offset"
        }
        Code::Locked => "another request holds the upload and does not let go; try again in a second",
        Code::InsufficientStorage => {
            "no room for this upload: it needs 4100000000 bytes and its job up to 900000000; 3900000000 are free, of which 0 \
             are reserved by uploads and jobs in progress and 536870912 must stay free; delete old stacks or enlarge the disk"
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

/// An example of each code that the document knows.
pub struct Examples(Vec<(Code, String, Value)>);

/// The examples, by the schema of the codes in the document.
pub fn all(document: &Value) -> Examples {
    let names = document["components"]["schemas"]["Code"]["enum"].as_array();
    let codes = names.into_iter().flatten().filter_map(|name| serde_json::from_value::<Code>(name.clone()).ok());
    let example = |code: Code| {
        let told = problem(&Fault::new(code, sentence(code)), Some("/v1/stacks".to_owned()));
        (code, code_name(code), json!({ "summary": told.title, "value": told }))
    };
    Examples(codes.map(example).collect())
}

impl Examples {
    /// The content of an answer of this status: a problem, with an example of each code that the description names.
    /// The schema is the same for all, so that a generated client has one class of errors.
    pub fn content(&self, description: &str, answered: &str) -> Value {
        let is_named = |name: &str| description.contains(&format!("`{name}`"));
        let named = self.0.iter().filter(|(code, name, _)| status(*code).as_str() == answered && is_named(name));
        let examples: Map<String, Value> =
            named.map(|(_, name, _)| (name.clone(), json!({ "$ref": reference(name) }))).collect();
        json!({ PROBLEM_JSON: { "schema": { "$ref": "#/components/schemas/Problem" }, "examples": examples } })
    }

    /// Those that an answer refers to: the codes of failed jobs are none of them.
    pub fn used_in(&self, document: &Value) -> Value {
        let text = document["paths"].to_string();
        let used = self.0.iter().filter(|(_, name, _)| text.contains(&format!("\"{}\"", reference(name))));
        used.map(|(_, name, example)| (name.clone(), example.clone())).collect::<Map<String, Value>>().into()
    }
}

fn reference(name: &str) -> String {
    format!("#/components/examples/{name}")
}
