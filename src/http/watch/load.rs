//! One job, of the kind that its URL says.

use uuid::Uuid;

use crate::{
    http::{
        log,
        problem::{ApiError, ApiResult},
        state::App,
    },
    model::{Code, JobKind},
    store::Job,
};

/// The job with this id.
///
/// # Errors
/// `not_found` when there is none of this kind.
pub async fn load(app: &App, id: Uuid, kind: JobKind) -> ApiResult<Job> {
    let job = app.rows.job(id).await?.filter(|job| job.request.kind() == kind);
    let what = match kind {
        JobKind::Stack => "stack",
        JobKind::Calibration => "calibration",
    };
    let job = job.ok_or_else(|| ApiError::new(Code::NotFound, format!("there is no {what} {id}")))?;
    log::note("rig", &job.rig);
    log::note("lens", &job.lens);
    Ok(job)
}
