//! What stacks and calibrations have in common.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::{
    contract::{JobKind, JobState, Name, Problem, Progress, outcome::Artifact, request::Upload},
    http::problem,
    store::Job,
};
use pinstack_science::types::Warning;

/// The part of a stack or a calibration that tells how its work goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// UUIDv7.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// Where it is in its life.
    pub state: JobState,
    /// How far it is.
    pub progress: Progress,
    /// How often a worker took it; above 1 an earlier worker died on it.
    pub attempt: u32,
    /// Somebody asked for its end; it is cancelled as soon as its worker sees that.
    pub cancel_requested: bool,
    /// When it was accepted.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When a worker first took it; null before.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub started_at: Option<Timestamp>,
    /// When it ended; null before.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub finished_at: Option<Timestamp>,
    /// Why it failed; null unless `state` is `failed`.
    pub error: Option<Problem>,
    /// What did not stop the work but should be known.
    pub warnings: Vec<Warning>,
    /// The zip as it arrived.
    pub upload: UploadView,
}

/// The zip as it arrived.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UploadView {
    /// Size.
    pub bytes: u64,
    /// SHA-256, hex: compare it with the file before that is deleted.
    pub sha256: String,
    /// Name that the client gave; null when it gave none.
    pub filename: Option<String>,
    /// True once it was removed because its time was over (`keep_uploads_days` of the server); the results are there.
    #[serde(default)]
    pub removed: bool,
}

/// A file that the job made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ArtifactView {
    /// `image`, `mask`, `backlight`, `depth`, `preview`, or `overlay-{slice}`.
    pub name: String,
    /// Where it can be had.
    pub href: String,
    /// `image/png`, `image/tiff` or `image/jpeg`.
    pub media_type: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256, hex: its `ETag`.
    pub sha256: String,
}

impl JobView {
    /// The common part of a row.
    pub fn of(job: &Job) -> Self {
        let Upload { bytes, sha256, filename, .. } = job.request.upload().clone();
        Self {
            id: job.id,
            rig: job.rig.clone(),
            lens: job.lens.clone(),
            state: job.state,
            progress: job.progress.clone(),
            attempt: job.attempt,
            cancel_requested: job.cancel_requested,
            created_at: job.created_at,
            started_at: job.started_at,
            finished_at: job.finished_at,
            error: job.error.as_ref().map(|fault| problem::problem(fault, Some(url(job)))),
            warnings: job.warnings.clone(),
            upload: UploadView { bytes, sha256, filename, removed: job.upload_removed },
        }
    }
}

impl ArtifactView {
    /// A file of a job, with its URL.
    pub fn of(artifact: &Artifact, href: String) -> Self {
        Self {
            name: artifact.name.clone(),
            href,
            media_type: artifact.media_type.clone(),
            bytes: artifact.bytes,
            sha256: artifact.sha256.clone(),
        }
    }
}

/// Where a job lives.
pub fn url(job: &Job) -> String {
    let id = job.id;
    match job.request.kind() {
        JobKind::Stack => format!("/v1/stacks/{id}"),
        JobKind::Calibration => format!("/v1/calibrations/{id}"),
    }
}

/// Where the profile revision that a job used or made lives.
pub fn profile_url(job: &Job, revision: u32) -> String {
    format!("/v1/profiles/{}/{}?revision={revision}", job.rig, job.lens)
}
