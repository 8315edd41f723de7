//! A stack, as the contract shows it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::job::{ArtifactView, JobView, profile_url, url};
use crate::{
    contract::{
        options::StackOptions,
        outcome::{ImageInfo, JobOutcome},
        request::JobRequest,
    },
    store::Job,
};
use pinstack_science::types::{metrics::Metrics, stack_layout::StackLayout};

/// A focus stack and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Stack {
    /// How the work goes.
    #[serde(flatten)]
    pub job: JobView,
    /// Revision of the profile that is used, fixed when the stack was accepted.
    pub profile_revision: u32,
    /// SHA-256 of that revision's geometry and gains, hex.
    pub profile_digest: String,
    /// SHA-256 of what that revision says about the camera, hex: EXIF and intrinsics are made from it. Null for a stack
    /// of before there was one.
    pub profile_optics_digest: Option<String>,
    /// The stack whose zip is used again; null when the zip was sent for this stack.
    pub rerun_of: Option<Uuid>,
    /// Every option as it is used, defaults filled in.
    pub options: StackOptions,
    /// The slices in the order in which they are used.
    pub slices: StackLayout,
    /// The image that came out; null before the end.
    pub image: Option<ImageInfo>,
    /// Program and version that made the results; null before the end.
    pub software: Option<String>,
    /// Its quality; null before the end.
    pub metrics: Option<Metrics>,
    /// The files that were made; empty before the end.
    pub artifacts: Vec<ArtifactView>,
    /// Where to go from here.
    pub links: StackLinks,
}

/// URLs of a stack; those of results are there once the results are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StackLinks {
    /// This stack.
    #[serde(rename = "self")]
    pub this: String,
    /// Its server-sent events.
    pub events: String,
    /// The profile revision that it uses.
    pub profile: String,
    /// `POST` here to stop it; gone once it has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// `POST` here to fuse the same zip again; gone once the zip is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rerun: Option<String>,
    /// The zip as it was sent; gone once the zip is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upload: Option<String>,
    /// Its metrics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<String>,
    /// The masked RGBA image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// The alpha mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
    /// The fused back light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub backlight: Option<String>,
    /// The slice-index map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<String>,
    /// A small picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preview: Option<String>,
}

impl Stack {
    /// The view of a row; `None` when the row is no stack.
    pub fn of(job: &Job) -> Option<Self> {
        let JobRequest::Stack(request) = &job.request else { return None };
        let outcome = match &job.outcome {
            Some(JobOutcome::Stack(outcome)) => Some(outcome),
            _ => None,
        };
        let url = url(job);
        let artifacts: Vec<ArtifactView> = outcome
            .map(|o| o.artifacts.iter().map(|a| ArtifactView::of(a, format!("{url}/{}", a.name))).collect())
            .unwrap_or_default();
        let link = |name: &str| artifacts.iter().find(|a| a.name == name).map(|a| a.href.clone());
        let links = StackLinks {
            events: format!("{url}/events"),
            profile: profile_url(job, request.profile_revision),
            cancel: (!job.state.is_final()).then(|| format!("{url}/cancel")),
            rerun: (!job.upload_removed).then(|| format!("{url}/rerun")),
            upload: (!job.upload_removed).then(|| format!("{url}/upload")),
            metrics: outcome.map(|_| format!("{url}/metrics")),
            image: link("image"),
            mask: link("mask"),
            backlight: link("backlight"),
            depth: link("depth"),
            preview: link("preview"),
            this: url,
        };
        Some(Self {
            job: JobView::of(job),
            profile_revision: request.profile_revision,
            profile_digest: request.profile_digest.clone(),
            profile_optics_digest: request.profile_optics_digest.clone(),
            rerun_of: request.rerun_of,
            options: request.options.clone(),
            slices: request.layout.clone(),
            image: outcome.map(|o| o.image.clone()),
            software: outcome.and_then(|o| o.software.clone()),
            metrics: outcome.map(|o| o.metrics.clone()),
            artifacts,
            links,
        })
    }
}
