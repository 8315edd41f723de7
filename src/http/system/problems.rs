//! `GET /problems/{code}`: where the `type` of a problem leads.

use axum::{Json, extract::Path};
use serde::Serialize;
use utoipa::ToSchema;

use super::examples::sentence;
use crate::{
    contract::{Code, one_line},
    http::problem::{ApiError, ApiResult, status, title},
};

/// A kind of problem.
#[derive(Serialize, ToSchema)]
pub struct ProblemKind {
    /// Stable code.
    code: Code,
    /// HTTP status that it is answered with. A job that fails shows the same code.
    status: u16,
    /// The `title` of such a problem.
    title: &'static str,
    /// What it means and what to do.
    description: &'static str,
    /// A `detail` as one was really said.
    example: &'static str,
}

impl ProblemKind {
    fn of(code: Code) -> Self {
        Self {
            code,
            status: status(code).as_u16(),
            title: title(code),
            description: description(code),
            example: sentence(code),
        }
    }
}

/// Get a kind of problem
///
/// The `type` of every problem is the URL of this page.
#[utoipa::path(
    get,
    path = "/problems/{code}",
    operation_id = "get_problem_kind",
    tag = "service",
    params(("code" = String, Path, description = "The `code` of a problem")),
    responses(
        (status = 200, description = "What it means and what to do", body = ProblemKind),
        (status = 404, description = "`not_found`: no such code"),
    )
)]
pub async fn problem_kind(Path(name): Path<String>) -> ApiResult<Json<ProblemKind>> {
    match serde_json::from_value(serde_json::Value::String(name.clone())) {
        Ok(code) => Ok(Json(ProblemKind::of(code))),
        Err(_) => {
            let shown: String = name.chars().take(80).collect();
            let shown = one_line(&shown);
            let detail =
                format!("there is no problem with the code '{shown}'; the schema Code in /openapi.json lists all");
            Err(ApiError::new(Code::NotFound, detail))
        }
    }
}

/// What a code means and what to do.
fn description(code: Code) -> &'static str {
    match code {
        Code::InvalidRequest => {
            "A parameter, header or body breaks a rule of the contract. The detail names it and the rule; /openapi.json has all \
             rules."
        }
        Code::Unauthorized => {
            "The service asks for a token, and the request brought none that is valid. Send 'Authorization: Bearer <token>'; \
             'pinstack token add' makes tokens."
        }
        Code::Forbidden => {
            "The token is valid but its scopes do not allow this request. The detail names the scope it needs."
        }
        Code::CrossOriginRequest => {
            "A page of another origin sent a request that changes something, and the service asks for no token. Add the origin \
             to cors_origins, or ask for tokens."
        }
        Code::MisdirectedRequest => {
            "The Host header is neither an address of the service nor one of its names, and the service asks for no token. A \
             page of the web could read the service through such a name. Add the name to the setting 'hosts'."
        }
        Code::TooManyRequests => {
            "Too many requests of this token are in progress: uploads, downloads, event streams, requests that wait. Wait \
             until one has ended; Retry-After says when to try again."
        }
        Code::NotFound => "There is no such URL, job, file or revision, or the token does not see it.",
        Code::MethodNotAllowed => {
            "The URL exists, but not with this method. The Allow header names the methods it has."
        }
        Code::MethodNotImplemented => "HTTP has no such method, or this service does not know it.",
        Code::ProfileNotFound => {
            "No profile is stored under this rig and lens. Calibrate it or PUT one, or correct the names; GET /v1/profiles \
             lists all."
        }
        Code::NotFinished => "The job has not ended, so its result does not exist yet. Wait, or follow its events.",
        Code::NoResult => {
            "The job ended without this result: it failed, was cancelled, or was made without a back light. The job says why."
        }
        Code::UploadRemoved => {
            "The zip of the stack was removed because its time was over (keep_uploads_days of the server). The results are \
             there; send the zip again for another result."
        }
        Code::Conflict => "The state of the job or upload does not allow this. Read the state again and decide.",
        Code::PreconditionFailed => {
            "If-Match named a revision that is not the current one, or another version of tus was asked for. Read again and \
             decide."
        }
        Code::IdempotencyKeyReused => {
            "The same Idempotency-Key came before with other parameters or another file. Use a new key for each stack."
        }
        Code::UnsupportedMediaType => {
            "The Content-Type of the body is not one that this call takes. The detail names those that it takes."
        }
        Code::NotAcceptable => "Accept allows no format that can be made. The detail names the formats.",
        Code::RangeNotSatisfiable => {
            "The Range begins behind the end of the file. The Content-Range header has its length."
        }
        Code::UploadTooLarge => "The body is larger than allowed. GET /v1/info shows every limit.",
        Code::UploadIncomplete => {
            "The body ended early or stopped coming. Send it again, or use /v1/uploads, which goes on where it was."
        }
        Code::ChecksumMismatch => {
            "The bytes of the piece are not those of its Upload-Checksum. None of them were kept; send them again."
        }
        Code::Locked => "Another request works on this upload and does not end. Try again after Retry-After.",
        Code::InsufficientStorage => {
            "The disk or the quota of the token has too little room. The detail has the figures; delete old stacks, or enlarge \
             it."
        }
        Code::QueueFull => "Too many jobs wait, or too many uploads are open. Try again after Retry-After.",
        Code::InvalidArchive => {
            "The body is not a zip, is damaged, or has names that break the rules. Make the zip again and send it again."
        }
        Code::UnsupportedArchive => {
            "The zip has an encrypted member or a compression that is not supported. Store or deflate, without a password."
        }
        Code::ArchiveTooLarge => "The zip has too many members or would unpack past the limits of GET /v1/info.",
        Code::InvalidImage => {
            "A slice is not a picture that can be read, is cut off, or declares absurd dimensions. The detail names the file."
        }
        Code::SizeMismatch => {
            "The slices differ in size from one another or from the profile. Check the camera's settings, or calibrate again."
        }
        Code::SliceCountMismatch => {
            "The zip has not as many slices as the profile, or front and back differ. Look for missing or extra pictures."
        }
        Code::InvalidProfile => {
            "A homography is singular, mirrored or not finite, or another number of the profile cannot be. The pointer says \
             where."
        }
        Code::TargetNotFound => {
            "The dots of the target were not found in too many slices. The detail names the slices; GET \
             /v1/calibrations/{id}/overlay shows what was found."
        }
        Code::MaskFailed => "mask=required, and no mask could be made. Add a back-light stack in the folder 'back'.",
        Code::WorkerLost => {
            "The process that worked on the job died on it several times, so it was given up. Look into the log of the service, \
             memory first."
        }
        Code::Unavailable => "The service goes down or cannot work at the moment. Try again after Retry-After.",
        Code::Internal => {
            "A fault of the service itself. Its log has the details under the request id of the X-Request-Id header."
        }
    }
}
