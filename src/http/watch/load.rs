//! One job, of the kind that its URL says.

use uuid::Uuid;

use crate::{
    contract::{Code, JobKind},
    http::{
        log,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::Job,
};

/// The job with this id.
///
/// # Errors
/// `not_found` when there is none of this kind.
pub async fn load(app: &App, id: Uuid, kind: JobKind) -> ApiResult<Job> {
    let job = app.rows.job(id).await?.filter(|job| job.request.kind() == kind);
    let job = job.ok_or_else(|| not_found(id, kind))?;
    log::note("rig", &job.rig);
    log::note("lens", &job.lens);
    Ok(job)
}

/// Whether there is a job with this id, without reading the rest of its row: what cannot be read can be deleted.
///
/// # Errors
/// `not_found` when there is none of this kind.
pub async fn require(app: &App, id: Uuid, kind: JobKind) -> ApiResult<()> {
    let found = app.rows.job_kind(id).await?.filter(|of| *of == kind);
    found.map(|_| ()).ok_or_else(|| not_found(id, kind))
}

fn not_found(id: Uuid, kind: JobKind) -> ApiError {
    let what = match kind {
        JobKind::Stack => "stack",
        JobKind::Calibration => "calibration",
    };
    ApiError::new(Code::NotFound, format!("there is no {what} {id}"))
}
