//! A reconstruction as the API shows it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::job::{ArtifactView, JobView, url};
use crate::{
    contract::{
        Name,
        outcome::JobOutcome,
        reconstruction::{ReconstructionOptions, ReconstructionRequest, ReconstructionResult, files},
    },
    http::scans,
    store::Job,
};

/// A reconstruction of the views of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Reconstruction {
    /// State and progress of the job.
    #[serde(flatten)]
    pub job: JobView,
    /// The scan.
    pub scan: Name,
    /// The options in use.
    pub options: ReconstructionOptions,
    /// What was found; null until the reconstruction has succeeded.
    pub result: Option<ReconstructionResult>,
    /// The files that were made; empty until the reconstruction has succeeded.
    pub artifacts: Vec<ArtifactView>,
    /// URLs of related resources.
    pub links: ReconstructionLinks,
}

/// URLs of a reconstruction. Those of results are present once it has succeeded with a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructionLinks {
    /// This reconstruction.
    #[serde(rename = "self")]
    pub this: String,
    /// Its server-sent events.
    pub events: String,
    /// `POST` here to cancel it; absent once it has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// The scan.
    pub scan: String,
    /// The points with their colours, PLY.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<String>,
    /// The cameras, JSON.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cameras: Option<String>,
    /// The visual hull, GLB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hull: Option<String>,
    /// The mesh of an outside program, PLY or GLB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// The model of COLMAP, a zip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// The report on the camera poses; add `?format=`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<String>,
    /// What COLMAP said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
}

impl Reconstruction {
    /// The view of a row; `request` is the request of that row.
    pub fn of(job: &Job, request: &ReconstructionRequest) -> Self {
        let outcome = match &job.outcome {
            Some(JobOutcome::Reconstruction(outcome)) => Some(outcome),
            _ => None,
        };
        let url = url(job);
        let made = outcome.map(|outcome| outcome.artifacts.as_slice()).unwrap_or_default();
        let href = |name: &str| made.iter().any(|made| made.name == name).then(|| format!("{url}/{name}"));
        let links = ReconstructionLinks {
            events: format!("{url}/events"),
            cancel: (!job.state.is_final()).then(|| format!("{url}/cancel")),
            scan: scans::url(&request.scan),
            points: href(files::POINTS),
            cameras: href(files::CAMERAS),
            hull: href(files::HULL),
            mesh: href(files::MESH),
            model: href(files::MODEL),
            poses: href(files::POSES),
            log: href(files::LOG),
            this: url.clone(),
        };
        Self {
            job: JobView::of(job),
            scan: request.scan.clone(),
            options: request.options,
            result: outcome.map(|outcome| outcome.result.clone()),
            artifacts: made.iter().map(|made| ArtifactView::of(made, format!("{url}/{}", made.name))).collect(),
            links,
        }
    }
}
