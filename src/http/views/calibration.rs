//! A calibration, as the contract shows it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::job::{ArtifactView, JobView, profile_url, url};
use crate::{
    contract::{outcome::JobOutcome, request::JobRequest},
    store::Job,
};
use pinstack_science::types::{
    calibration_options::CalibrationOptions,
    profile::ProfileSlice,
    report::{CalibrationReport, Drift},
    stack_layout::StackLayout,
};

/// A dot-target stack and the profile that was measured from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    /// How the work goes.
    #[serde(flatten)]
    pub job: JobView,
    /// What was asked for.
    pub options: CalibrationOptions,
    /// The slices in the order in which they are used.
    pub slices: StackLayout,
    /// What was measured; null before the end.
    pub result: Option<CalibrationResult>,
    /// The pictures that were made; empty before the end.
    pub artifacts: Vec<ArtifactView>,
    /// Where to go from here.
    pub links: CalibrationLinks,
}

/// What a calibration measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationResult {
    /// The profile revision that was stored.
    pub profile_revision: u32,
    /// SHA-256 of its geometry and gains, hex.
    pub profile_digest: String,
    /// SHA-256 of what it says about the camera, hex. Null for a calibration of before there was one.
    pub profile_optics_digest: Option<String>,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// One entry per slice.
    pub slices: Vec<ProfileSlice>,
    /// Distance between neighbouring dots in the reference slice, px.
    pub dot_pitch_px: Option<f64>,
    /// Image size over object size; null unless pitch and pixel size were told.
    pub magnification: Option<f64>,
    /// One sentence for the technician.
    pub verdict: String,
}

/// The report of a calibration, as data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportView {
    /// What was found.
    #[serde(flatten)]
    pub report: CalibrationReport,
    /// How far the rig moved since the revision before; null when there is none.
    pub drift: Option<Drift>,
}

/// URLs of a calibration; those of results are there once the results are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationLinks {
    /// This calibration.
    #[serde(rename = "self")]
    pub this: String,
    /// Its server-sent events.
    pub events: String,
    /// `POST` here to stop it; gone once it has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// The profile revision that it made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// The reference slice with the dots found; `?slice=N` shows another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlay: Option<String>,
    /// What was found, as a page for the technician; as JSON with `Accept: application/json`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
}

/// The artifact that the report is kept as.
pub const REPORT: &str = "report";

impl Calibration {
    /// The view of a row; `None` when the row is no calibration.
    pub fn of(job: &Job) -> Option<Self> {
        let JobRequest::Calibration(request) = &job.request else { return None };
        let outcome = match &job.outcome {
            Some(JobOutcome::Calibration(outcome)) => Some(outcome),
            _ => None,
        };
        let url = url(job);
        let href = |name: &str| match name.strip_prefix("overlay-") {
            Some(slice) => format!("{url}/overlay?slice={slice}"),
            None => format!("{url}/{name}"),
        };
        // the report is kept as a file but shown as a page that is made when it is asked for
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
        });
        let links = CalibrationLinks {
            events: format!("{url}/events"),
            cancel: (!job.state.is_final()).then(|| format!("{url}/cancel")),
            profile: outcome.map(|o| profile_url(job, o.profile_revision)),
            overlay: outcome.map(|_| format!("{url}/overlay")),
            report: has_report.then(|| format!("{url}/report")),
            this: url,
        };
        Some(Self {
            job: JobView::of(job),
            options: request.options.clone(),
            slices: request.layout.clone(),
            result,
            artifacts,
            links,
        })
    }
}
