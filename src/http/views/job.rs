//! What stacks, calibrations and reconstructions have in common, as the API shows it.

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

/// State and progress of a stack, a calibration or a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// UUIDv7.
    pub id: Uuid,
    /// Rig of the profile.
    pub rig: Name,
    /// Lens of the profile.
    pub lens: Name,
    /// State of the job.
    pub state: JobState,
    /// Progress of the job.
    pub progress: Progress,
    /// Number of attempts that count. Above 1: in an earlier attempt the worker died, or the machine failed (such as a
    /// full disk).
    pub attempt: u32,
    /// True when cancellation was requested. The job is cancelled as soon as its worker sees the request.
    pub cancel_requested: bool,
    /// When it was accepted.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When a worker first claimed it; null before.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub started_at: Option<Timestamp>,
    /// When it ended; null before.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub finished_at: Option<Timestamp>,
    /// Why it failed; null unless `state` is `failed`.
    pub error: Option<Problem>,
    /// Problems that did not stop the job.
    pub warnings: Vec<Warning>,
    /// The zip as it was sent; of a reconstruction, all pictures that it reads.
    pub upload: UploadView,
}

/// The zip as it was sent. Of a reconstruction, size and digest of all pictures that it reads: equal for equal
/// pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UploadView {
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex. Compare it with your file before you delete that.
    pub sha256: String,
    /// File name that the client gave; null when it gave none.
    pub filename: Option<String>,
    /// True once the zip was removed at the end of its retention period (`keep_uploads_days` of the server). The
    /// results are kept.
    #[serde(default)]
    pub removed: bool,
}

/// A result file of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ArtifactView {
    // in the OpenAPI document, `system/schemas.rs` lists the names in place of this sentence
    /// The name of a [`StackArtifact`](crate::contract::artifact::StackArtifact), `lights/{name}`, `overlay-{slice}`,
    /// or the name of a file of a reconstruction.
    pub name: String,
    /// URL of the file.
    pub href: String,
    /// `image/png`, `image/tiff` or `image/jpeg`; others of a reconstruction.
    pub media_type: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex; also its `ETag`.
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
    /// The view of an artifact with its URL.
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

/// URL of a job.
pub fn url(job: &Job) -> String {
    url_of(job.request.kind(), job.id)
}

/// URL of the job of a kind.
pub fn url_of(kind: JobKind, id: Uuid) -> String {
    match kind {
        JobKind::Stack => link!("/v1/stacks/{id}"),
        JobKind::Calibration => link!("/v1/calibrations/{id}"),
        JobKind::Reconstruction => link!("/v1/reconstructions/{id}"),
    }
}

/// URL of the profile revision that a job used or made.
pub fn profile_url(job: &Job, revision: u32) -> String {
    link!("/v1/profiles/{}/{}?revision={revision}", job.rig, job.lens)
}
