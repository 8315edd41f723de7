//! A stack as the API shows it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{
    advice::{Advice, advice},
    job::{ArtifactView, JobView, profile_url, url},
};
use crate::{
    contract::{
        Verdict,
        artifact::{StackArtifact, light_of, stack_artifacts},
        options::StackOptions,
        outcome::{Artifact, HeightInfo, ImageInfo, JobOutcome, StackOutcome},
        request::StackRequest,
    },
    store::Job,
};
use pinstack_science::types::{metrics::Metrics, stack_layout::StackLayout};

/// A focus stack and its results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Stack {
    /// State and progress of the job.
    #[serde(flatten)]
    pub job: JobView,
    /// The verdict on the result: `use`, `look` (at it, before it is used) or `do_not_use`; null until the stack has
    /// succeeded.
    pub verdict: Option<Verdict>,
    /// What was found, the worst first, with what to do.
    pub advice: Vec<Advice>,
    /// Revision of the profile in use, fixed when the stack was accepted.
    pub profile_revision: u32,
    /// SHA-256 of the geometry and gains of that revision, hex.
    pub profile_digest: String,
    /// SHA-256 of what that revision states about the camera, hex: the source of EXIF and intrinsics. Null for a stack
    /// older than this member.
    pub profile_optics_digest: Option<String>,
    /// For a rerun: the stack whose zip is used again. Null when the zip was sent for this stack.
    pub rerun_of: Option<Uuid>,
    /// All options in use, with defaults filled in.
    pub options: StackOptions,
    /// The slices, in the order in which they are fused.
    pub slices: StackLayout,
    /// Properties of the fused image; null until the stack has succeeded.
    pub image: Option<ImageInfo>,
    /// How to read the height map; null without one.
    pub height: Option<HeightInfo>,
    /// Program and version that made the results; null until the stack has succeeded.
    pub software: Option<String>,
    /// Quality metrics; null until the stack has succeeded.
    pub metrics: Option<Metrics>,
    /// The result files; empty until the stack has succeeded.
    pub artifacts: Vec<ArtifactView>,
    /// URLs of related resources.
    pub links: StackLinks,
}

macro_rules! links {
    ($($variant:ident $member:ident { name: $_n:tt, link: $link:tt, $($_rest:tt)* })*) => {
        /// URLs of a stack. Those of results are present once it has succeeded.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
        pub struct StackLinks {
            /// This stack.
            #[serde(rename = "self")]
            pub this: String,
            /// Its server-sent events.
            pub events: String,
            /// The profile revision in use.
            pub profile: String,
            /// `POST` here to cancel it; absent once it has ended.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub cancel: Option<String>,
            /// `POST` here to fuse the same zip again; absent once the zip was removed.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub rerun: Option<String>,
            /// The zip as it was sent; absent once it was removed.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub upload: Option<String>,
            /// Its metrics.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub metrics: Option<String>,
            /// The pictures of the further lights, by name; absent without any.
            #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
            pub lights: BTreeMap<String, String>,
            $(
                #[doc = $link]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $member: Option<String>,
            )*
        }

        impl StackLinks {
            fn of(job: &Job, request: &StackRequest, outcome: Option<&StackOutcome>) -> Self {
                let url = url(job);
                let files = outcome.map(|outcome| outcome.artifacts.as_slice()).unwrap_or_default();
                let link = |of: StackArtifact| of.among(files).map(|file| format!("{url}/{}", file.name));
                let light = |file: &Artifact| Some((light_of(&file.name)?.to_owned(), format!("{url}/{}", file.name)));
                Self {
                    lights: files.iter().filter_map(light).collect(),
                    events: format!("{url}/events"),
                    profile: profile_url(job, request.profile_revision),
                    cancel: (!job.state.is_final()).then(|| format!("{url}/cancel")),
                    rerun: (!job.upload_removed).then(|| format!("{url}/rerun")),
                    upload: (!job.upload_removed).then(|| format!("{url}/upload")),
                    metrics: outcome.map(|_| format!("{url}/metrics")),
                    $($member: link(StackArtifact::$variant),)*
                    this: url,
                }
            }
        }
    };
}
stack_artifacts!(links);

impl Stack {
    /// The view of a row; `request` is the request of that row.
    pub fn of(job: &Job, request: &StackRequest) -> Self {
        let outcome = match &job.outcome {
            Some(JobOutcome::Stack(outcome)) => Some(outcome),
            _ => None,
        };
        let url = url(job);
        let artifacts: Vec<ArtifactView> = outcome
            .map(|o| o.artifacts.iter().map(|a| ArtifactView::of(a, format!("{url}/{}", a.name))).collect())
            .unwrap_or_default();
        Self {
            job: JobView::of(job),
            verdict: job.verdict(),
            advice: advice(job, request),
            profile_revision: request.profile_revision,
            profile_digest: request.profile_digest.clone(),
            profile_optics_digest: request.profile_optics_digest.clone(),
            rerun_of: request.rerun_of,
            options: request.options.clone(),
            slices: request.layout.clone(),
            image: outcome.map(|o| o.image.clone()),
            height: outcome.and_then(|o| o.height.clone()),
            software: outcome.and_then(|o| o.software.clone()),
            metrics: outcome.map(|o| o.metrics.clone()),
            artifacts,
            links: StackLinks::of(job, request, outcome),
        }
    }
}
