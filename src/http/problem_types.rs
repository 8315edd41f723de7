//! The table of problem types: one row per [`Code`]. A new code needs its variant and one row here.
//!
//! | column | use |
//! |---|---|
//! | status | HTTP status of the answer |
//! | retry | whether the same request can succeed later, and after how many seconds (`Retry-After`) |
//! | title | `title` of the problem, the same for every problem of the code |
//! | description | `GET /problems/{code}`: what it means and what to do |
//! | example | `detail` of the example in `/openapi.json` and `GET /problems/{code}` |

use axum::http::{StatusCode, StatusCode as S};

use self::Retry::{AfterSeconds, Later, Never};
use crate::contract::Code;

/// Whether the same request, or the completion of the same upload, can succeed later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Retry {
    /// No: its content, its names or its options are wrong.
    Never,
    /// Yes, once the cause is gone: a missing right, a lock, a full disk, an error of the machine.
    Later,
    /// Yes, and the answer has `Retry-After` with this many seconds.
    AfterSeconds(u16),
}

/// One row of the table.
#[derive(Debug, Clone, Copy)]
pub struct ProblemType {
    /// HTTP status of the answer.
    pub status: StatusCode,
    /// Whether to retry.
    pub retry: Retry,
    /// Short name, the same for every problem of the code.
    pub title: &'static str,
    /// What it means and what to do.
    pub description: &'static str,
    /// A typical `detail`.
    pub example: &'static str,
}

/// A row: `code: status, retry, title, description, example`.
macro_rules! problem_types {
    ($($code:ident: $status:expr, $retry:expr, $title:expr, $description:expr, $example:expr;)*) => {
        /// The row of a code.
        pub fn problem_type(code: Code) -> ProblemType {
            let row = |status, retry, title, description, example| {
                ProblemType { status, retry, title, description, example }
            };
            match code {
                $(Code::$code => row($status, $retry, $title, $description, $example),)*
            }
        }
    };
}

problem_types! {
    InvalidRequest: S::BAD_REQUEST, Never, "Invalid request",
        "A parameter, header or body breaks a rule of the contract. The detail names it and the rule. /openapi.json \
         lists all rules.",
        "mask is 'maybe'; it must be one of: auto, none, required";

    Unauthorized: S::UNAUTHORIZED, Later, "Authentication required",
        "The service requires a token, and the request has no valid one. Send 'Authorization: Bearer <token>'. \
         'pinstack token add' makes tokens.",
        "this service requires a token: send 'Authorization: Bearer <token>' with a token made by 'pinstack token add' \
         that is not revoked";

    Forbidden: S::FORBIDDEN, Later, "Forbidden",
        "The token is valid, but its scopes do not allow this request. The detail names the scope that is missing.",
        "the token 'viewer' has the scopes: read; this request needs: stacks:write";

    CrossOriginRequest: S::FORBIDDEN, Later, "Cross-origin request refused",
        "A page of another origin sent a request that changes something, and the service requires no token. Add the \
         origin to the setting 'cors_origins', or require tokens. If the page is one of the service, a proxy has changed \
         the header Host: let the proxy pass it on.",
        "the request comes from a page of the origin https://other.example; while the service requires no token, \
         it accepts changes only from its own pages and from programs that are not browsers; to allow an origin, \
         add it to the setting 'cors_origins'";

    MisdirectedRequest: S::MISDIRECTED_REQUEST, Later, "Misdirected request",
        "The Host header is neither an address of the service nor one of its names, and the service requires no token. \
         A web page could read the service through such a name (DNS rebinding). Add the name to the setting 'hosts'.",
        "the request is for the host 'other.example', which is not a name of this service; use its address, or add the \
         name to the setting 'hosts' (PINSTACK_HOSTS); a proxy in between must pass on the header Host of the client";

    TooManyRequests: S::TOO_MANY_REQUESTS, AfterSeconds(1), "Too many requests in progress",
        "Too many requests of this token are in progress: uploads, downloads, event streams, waiting requests. Retry \
         after the seconds in Retry-After, when one has ended.",
        "the token 'rig-pc' has 256 requests in progress, which is its limit; retry when one has ended";

    NotFound: S::NOT_FOUND, Never, "Not found",
        "There is no such URL, job, file or revision, or the token must not see it.",
        "there is no stack 0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10";

    MethodNotAllowed: S::METHOD_NOT_ALLOWED, Never, "Method not allowed",
        "The URL exists, but not with this method. The Allow header lists its methods.",
        "POST is not allowed on /v1/info; the Allow header lists the methods that are";

    MethodNotImplemented: S::NOT_IMPLEMENTED, Later, "Method not implemented",
        "HTTP has no such method, or this service does not support it.",
        "'FETCH' is not an HTTP method that this service supports";

    ProfileNotFound: S::NOT_FOUND, Never, "Profile not found",
        "No profile is stored for this rig and lens. Calibrate the rig, PUT a profile, or correct the names. GET \
         /v1/profiles lists all profiles.",
        "there is no profile for rig 'turntable-1' and lens 'mpe65-2x'; calibrate it, or PUT \
         /v1/profiles/turntable-1/mpe65-2x first";

    NotFinished: S::CONFLICT, Later, "Job not finished",
        "The job has not ended, so its result does not exist yet. Wait, or follow its events.",
        "the job is running; its results are available when it has succeeded";

    NoResult: S::NOT_FOUND, Never, "No such result",
        "The job ended without this result: it failed, was cancelled, or had no back light. The job shows why.",
        "there is no mask: the stack has no back-light slices";

    ScanNotFound: S::NOT_FOUND, Later, "Scan not found",
        "No scan is stored under this name. Create it with PUT /v1/scans/{scan} before stacks are sent to it, or correct \
         the name.",
        "there is no scan 'bee-24' (there is 'bee-42'); create it with PUT /v1/scans/bee-24, or correct the name";

    ScanMismatch: S::UNPROCESSABLE_ENTITY, Later, "Views do not fit together",
        "All views of a scan need one camera and one canvas: the same rig and lens, and for a bundle images of one size, \
         crop and profile revision. The detail names the views that differ.",
        "the scan 'bee-42' is of rig 'turntable-1' and lens 'mpe65-2x', the stack is of rig 'turntable-2' and \
         lens 'mpe65-2x'; all views of a scan need one camera: use another scan, or send the stack with the rig \
         and lens of the scan";

    UploadRemoved: S::GONE, Never, "Upload removed",
        "The zip of the stack has expired and was removed (setting 'keep_uploads_days' of the server). The results \
         remain. Send the zip again to fuse it again.",
        "the zip of this stack was removed at the end of its retention period (keep_uploads_days of the server); its \
         results are kept; send the zip again to fuse it with other options";

    Conflict: S::CONFLICT, Later, "Conflict",
        "The state of the job or upload does not allow this. Read the current state and decide.",
        "the stack has already succeeded, so it cannot be cancelled";

    PreconditionFailed: S::PRECONDITION_FAILED, Later, "Precondition failed",
        "The profile was changed in the meantime: If-Match names a revision that is not the current one. Or the request \
         asks for a version of tus that is not supported. Read the current state and decide.",
        "the profile of rig 'turntable-1' and lens 'mpe65-2x' is at revision 4, which does not satisfy if-match; read the \
         profile again and retry";

    IdempotencyKeyReused: S::UNPROCESSABLE_ENTITY, Never, "Idempotency key reused",
        "The same Idempotency-Key was sent before with other parameters or another file. Use a new key for each stack.",
        "the Idempotency-Key 'bee-17' was used before with another rig, lens, options or file; use a new key per stack";

    UnsupportedMediaType: S::UNSUPPORTED_MEDIA_TYPE, Never, "Unsupported media type",
        "This operation does not accept the Content-Type of the body. The detail lists the types that it accepts.",
        "the body is 'image/jpeg'; send the zip as application/zip, or in a multipart/form-data form";

    NotAcceptable: S::NOT_ACCEPTABLE, Never, "Not acceptable",
        "The Accept header allows no format that is available. The detail lists the formats.",
        "the report is available as text/html and application/json; name one of them in Accept";

    RangeNotSatisfiable: S::RANGE_NOT_SATISFIABLE, Never, "Range not satisfiable",
        "The range begins after the end of the file. The Content-Range header has the length of the file.",
        "the range is outside the file, which has 48210 bytes";

    UploadTooLarge: S::PAYLOAD_TOO_LARGE, Never, "Upload too large",
        "The body is larger than allowed, and GET /v1/info shows every limit; or storing it took too long for one request: use /v1/uploads.",
        "the upload is larger than the limit of 68719476736 bytes; GET /v1/info shows all limits";

    UploadIncomplete: S::BAD_REQUEST, Later, "Upload incomplete",
        "The body ended early, or no data arrived until the timeout. Send it again, or use /v1/uploads, which can resume.",
        "the upload ended before its last byte; nothing was stored; send it again";

    ChecksumMismatch: checksum_mismatch(), Later, "Checksum mismatch",
        "The bytes of the request do not match its Upload-Checksum. None of them were kept. Send them again.",
        "the bytes of this request do not match its Upload-Checksum; none of them were stored; send them again \
         from the same offset";

    Locked: S::LOCKED, AfterSeconds(1), "Upload is locked by another request",
        "Another request works on this upload and did not release it in time. Retry after the seconds in Retry-After.",
        "another request is writing to upload 0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10 and has not released it; try \
         again in a moment";

    InsufficientStorage: S::INSUFFICIENT_STORAGE, Later, "Insufficient storage",
        "The disk or the quota of the token has too little free space, or the machine too little memory for a job. The \
         detail has the figures. Delete old stacks, or enlarge the disk, the quota or the memory.",
        "not enough disk space for this upload: it needs 4100000000 bytes and its job up to 900000000; \
         3900000000 bytes are free, of which 0 are reserved by uploads and jobs in progress and 536870912 must \
         stay free; delete old stacks or enlarge the disk";

    QueueFull: S::SERVICE_UNAVAILABLE, AfterSeconds(30), "Queue full",
        "Too many jobs are queued, or too many uploads are open. Retry after the seconds in Retry-After.",
        "the queue is full: 1000 jobs are waiting; try again later";

    InvalidArchive: S::UNPROCESSABLE_ENTITY, Never, "Invalid archive",
        "The body is not a zip, is damaged, or has names that break the rules. Make the zip again and send it again.",
        "front/img_3.jpg is damaged in the zip (Invalid checksum); was the upload cut off? Make the zip again and send \
         it again";

    UnsupportedArchive: S::UNPROCESSABLE_ENTITY, Never, "Unsupported archive",
        "The zip has an encrypted member or an unsupported compression. Use store or deflate, without a password.",
        "front/img_0.jpg is encrypted; make the zip without a password";

    ArchiveTooLarge: S::UNPROCESSABLE_ENTITY, Never, "Archive too large",
        "The zip has too many members or views, or would unpack to more than the limits allow. GET /v1/info shows every \
         limit.",
        "the zip has 30000 members; at most 2500 are allowed";

    InvalidImage: S::UNPROCESSABLE_ENTITY, Never, "Invalid image",
        "A slice is not a readable image, is truncated, or declares absurd dimensions. The detail names the file.",
        "front/img_3.jpg: the JPEG ends before the picture does (truncated file); copy it again from the camera";

    SizeMismatch: S::UNPROCESSABLE_ENTITY, Never, "Size mismatch",
        "The slices differ in size from one another or from the profile. Check the settings of the camera, or calibrate \
         again.",
        "the slices have 6000 x 4000 px; the profile of rig 'turntable-1' and lens 'mpe65-2x' (revision 3) is \
         for 5760 x 3840 px; set the camera to this size, or calibrate again";

    SliceCountMismatch: S::UNPROCESSABLE_ENTITY, Never, "Slice count mismatch",
        "The number of slices differs from the profile, or front and back differ. Look for missing or extra pictures.",
        "the archive has 20 front-light slices, the profile of rig 'turntable-1' and lens 'mpe65-2x' (revision \
         3) has 21; send all slices of the stack once, or calibrate again with this number of slices";

    InvalidProfile: S::UNPROCESSABLE_ENTITY, Never, "Invalid profile",
        "A homography is singular, mirrored or not finite, or another number of the profile is impossible. The pointer \
         names the place.",
        "the homography of slice 3 is mirrored; check that x and y are not exchanged";

    InvalidPoses: S::UNPROCESSABLE_ENTITY, Never, "Invalid poses",
        "The file is none that a reconstruction program writes for camera poses, is truncated, or has no registered \
         view. The detail names the line or the element.",
        "line 7: value 9 is ''; an image has a line of 10 values (IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME), and \
         a line with its points, which may be empty";

    TargetNotFound: S::UNPROCESSABLE_ENTITY, Never, "Target not found",
        "The dots of the target were not found in too many slices. The detail names the slices. GET \
         /v1/calibrations/{id}/overlay shows what was found.",
        "no grid of dots was found in the 3 slices that were searched (img_0.jpg, img_10.jpg, img_20.jpg); each \
         is blurred everywhere: focus on the target in at least one slice; the target needs at least 12 whole round \
         dots in 3 rows and 3 columns, sharp in at least one slice, evenly lit and not clipped";

    MaskFailed: S::UNPROCESSABLE_ENTITY, Never, "Mask failed",
        "mask=required, but no mask could be made. Add a back-light stack in the folder 'back'.",
        "mask=required, but the archive has no back-light slices; put them into a folder 'back', or send mask=auto";

    ReconstructionFailed: S::INTERNAL_SERVER_ERROR, Later, "Reconstruction failed",
        "COLMAP failed, or exceeded a limit of time, memory or disk. The detail says which, with its last words.",
        "the reconstruction took longer than 240 minutes and was stopped during mapper: raise the setting \
         reconstruction_minutes, or leave out views";

    WorkerLost: S::INTERNAL_SERVER_ERROR, Later, "Worker lost",
        "The worker process died several times while it ran this job, so the job failed. Check the log of the service, \
         first for memory.",
        "the worker died during attempt 3, the last one, so the job is not retried; the usual reason is a stack \
         that needs too much memory: send fewer or smaller slices, or add memory; the log of the service has more";

    Unavailable: S::SERVICE_UNAVAILABLE, AfterSeconds(5), "Service unavailable",
        "The service is shutting down or temporarily unable to work. Retry after the seconds in Retry-After.",
        "the server is shutting down; what arrived is stored, unless the request had an Upload-Checksum; when \
         the server is back, get the offset with HEAD and continue from there";

    Internal: S::INTERNAL_SERVER_ERROR, Later, "Internal error",
        "An error of the service itself. Its log has the cause under the request id of the X-Request-Id header.",
        INTERNAL;
}

/// The detail of every internal error.
pub const INTERNAL: &str =
    "an internal error occurred; the log of the server has the cause under the request id in X-Request-Id";

/// tus defines its own status for a wrong checksum.
fn checksum_mismatch() -> StatusCode {
    StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST)
}
