//! A calibration as the API shows it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::job::{ArtifactView, JobView, profile_url, url};
use crate::{
    contract::{
        artifact::{REPORT, overlay_slice},
        outcome::JobOutcome,
        request::CalibrationRequest,
    },
    store::Job,
};
use pinstack_science::types::{
    calibration_options::CalibrationOptions,
    profile::ProfileSlice,
    report::{CalibrationReport, Drift, Grade},
    stack_layout::StackLayout,
};

/// A dot target, or stacks, and the profile that was measured from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    /// State and progress of the job.
    #[serde(flatten)]
    pub job: JobView,
    /// The options in use.
    pub options: CalibrationOptions,
    /// The slices in the order in which they are used.
    pub slices: StackLayout,
    /// The stored stacks whose pictures it uses, by their ids; empty if the pictures were sent.
    pub stacks: Vec<Uuid>,
    /// What was measured; null until the calibration has succeeded.
    pub result: Option<CalibrationResult>,
    /// The pictures that were made; empty until the calibration has succeeded.
    pub artifacts: Vec<ArtifactView>,
    /// URLs of related resources.
    pub links: CalibrationLinks,
}

/// What a calibration measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationResult {
    /// Number of the profile revision that was stored. Null when the option `keep` excluded the calibration.
    pub profile_revision: Option<u32>,
    /// SHA-256 of the geometry and gains of that revision, hex. Null without a revision.
    pub profile_digest: Option<String>,
    /// SHA-256 of what that revision states about the camera, hex. Null without a revision, and for a calibration older
    /// than this member.
    pub profile_optics_digest: Option<String>,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// What was measured in each slice.
    pub slices: Vec<ProfileSlice>,
    /// Distance between neighbouring dots in the reference slice, px.
    pub dot_pitch_px: Option<f64>,
    /// Magnification (image size / object size). Null unless `target_pitch_mm` and `pixel_pitch_mm` were given.
    pub magnification: Option<f64>,
    /// A one-sentence summary for the operator of the rig.
    pub verdict: String,
    /// The verdict in one word. Null for a calibration older than this member.
    pub grade: Option<Grade>,
}

/// The report of a calibration, as data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportView {
    /// What was found.
    #[serde(flatten)]
    pub report: CalibrationReport,
    /// How far the rig moved since the previous revision; null when there is none.
    pub drift: Option<Drift>,
}

/// URLs of a calibration. Those of results are present once it has succeeded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationLinks {
    /// This calibration.
    #[serde(rename = "self")]
    pub this: String,
    /// Its server-sent events.
    pub events: String,
    /// `POST` here to cancel it; absent once it has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// The profile revision that it stored, if it stored one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// The reference slice with the detected dots drawn in; `?slice=N` shows another slice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlay: Option<String>,
    /// The report as an HTML page; as JSON with `Accept: application/json`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
}

impl Calibration {
    /// The view of a row; `request` is the request of that row.
    pub fn of(job: &Job, request: &CalibrationRequest) -> Self {
        let outcome = match &job.outcome {
            Some(JobOutcome::Calibration(outcome)) => Some(outcome),
            _ => None,
        };
        let url = url(job);
        let href = |name: &str| match overlay_slice(name) {
            Some(slice) => format!("{url}/overlay?slice={slice}"),
            None => format!("{url}/{name}"),
        };
        // the report is stored as data; its page is rendered on request
        let has_report = outcome.is_some_and(|o| o.artifacts.iter().any(|a| a.name == REPORT));
        let artifacts: Vec<ArtifactView> = outcome
            .map(|o| o.artifacts.iter().filter(|a| a.name != REPORT))
            .map(|pictures| pictures.map(|a| ArtifactView::of(a, href(&a.name))).collect())
            .unwrap_or_default();
        let result = outcome.map(|o| CalibrationResult {
            profile_revision: o.profile_revision,
            profile_digest: o.profile_digest.clone(),
            profile_optics_digest: o.profile_optics_digest.clone(),
            reference_index: o.reference_index,
            slices: o.slices.clone(),
            dot_pitch_px: o.dot_pitch_px,
            magnification: o.magnification,
            verdict: o.verdict.clone(),
            grade: o.grade,
        });
        let links = CalibrationLinks {
            events: format!("{url}/events"),
            cancel: (!job.state.is_final()).then(|| format!("{url}/cancel")),
            profile: outcome.and_then(|o| Some(profile_url(job, o.profile_revision?))),
            overlay: outcome.map(|_| format!("{url}/overlay")),
            report: has_report.then(|| format!("{url}/report")),
            this: url,
        };
        Self {
            job: JobView::of(job),
            options: request.options.clone(),
            slices: request.layout.clone(),
            stacks: request.stacks.iter().map(|stack| stack.id).collect(),
            result,
            artifacts,
            links,
        }
    }
}
