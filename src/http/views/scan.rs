//! A scan as the API shows it: what is stored of it, and the table of its views.

mod findings;

use std::{collections::HashMap, hash::Hash};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use self::findings::findings;
use super::job::url_of;
use crate::{
    contract::{JobKind, JobState, Problem, Scan, Verdict, verdict},
    http::{
        ApiResult, background, problem,
        scans::{
            table::{View, ViewStack},
            url,
        },
    },
};
use pinstack_science::{
    photogrammetry::{
        missing_views::missing_views,
        outliers::{Outlier, OutlierKind, outliers},
    },
    types::view::ViewAngles,
};

/// A scan with its views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanWithViews {
    /// What is stored of the scan.
    #[serde(flatten)]
    pub scan: Scan,
    /// The views by number and state.
    pub summary: ScanSummary,
    /// The views, by tilt, pan and name. Stacks with equal `label`, `pan_deg` and `tilt_deg` are one view; the newest
    /// that did not fail counts.
    pub views: Vec<ScanView>,
    /// Pan and tilt at which a view is missing from the grid that the others form.
    pub missing: Vec<ViewAngles>,
    /// What is conspicuous about the scan as a whole.
    pub findings: Vec<ScanFinding>,
    /// URLs of related resources.
    pub links: ScanLinks,
}

/// The views of a scan by number and state.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanSummary {
    /// How many views the scan will have; null when it is unknown.
    pub expected: Option<u32>,
    /// Views.
    pub views: u32,
    /// Views whose stack is queued.
    pub queued: u32,
    /// Views whose stack is running.
    pub running: u32,
    /// Views whose stack has succeeded.
    pub succeeded: u32,
    /// Views of which every stack failed or was cancelled.
    pub failed: u32,
    /// Further stacks, which a newer one of the same view replaces.
    pub replaced: u32,
}

/// A view of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanView {
    /// Name of its files in a bundle, without extension: the label, or pan and tilt. The same after a rerun.
    pub name: String,
    /// Label; null when none was given.
    pub label: Option<String>,
    /// Commanded pan, degrees; null when none was given.
    pub pan_deg: Option<f64>,
    /// Commanded tilt, degrees; null when none was given.
    pub tilt_deg: Option<f64>,
    /// URL of the stack that counts.
    pub stack: String,
    /// Its state.
    pub state: JobState,
    /// The verdict on it; a view that differs from its neighbours is to be looked at. Null until it has succeeded.
    pub verdict: Option<Verdict>,
    /// Completed fraction of it, 0 to 1.
    pub progress: f64,
    /// Why it failed; null unless `state` is `failed`.
    pub error: Option<Problem>,
    /// Revision of the profile that it is fused with.
    pub profile_revision: u32,
    /// Size of the fused image, `[width, height]` px; null until it has succeeded.
    pub image_size_px: Option<[u32; 2]>,
    /// Mean squared Sobel gradient of the fused image (`fusion.tenengrad`).
    pub sharpness: Option<f64>,
    /// Share of the canvas that is the object (`mask.foreground_fraction`).
    pub mask_area: Option<f64>,
    /// 95th percentile of the residual shifts between neighbouring slices, px (`alignment.residual_p95_px`).
    pub residual_px: Option<f64>,
    /// Mean grey level of the object, 0 to 255 (`fusion.mean_level`).
    pub mean_level: Option<f64>,
    /// Share of the object that is never in focus or smooth (`focus.unfocused_fraction`).
    pub unfocused_fraction: Option<f64>,
    /// Share of the border that the object touches (`mask.border_contact_fraction`); above 0 it is cut off.
    pub border_contact: Option<f64>,
    /// Codes of the findings of its metrics that are warnings.
    pub findings: Vec<String>,
    /// In what it differs from the neighbouring views.
    pub outliers: Vec<ViewOutlier>,
    /// URLs of further stacks of the view, newest first.
    pub replaced: Vec<String>,
}

/// A quantity in which a view differs from its neighbours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewOutlier {
    /// The quantity.
    pub kind: OutlierKind,
    /// Its value in this view.
    pub value: f64,
    /// The median of the nearest views.
    pub expected: f64,
    /// The same as a sentence, with what to do.
    pub detail: String,
}

/// Something conspicuous about a scan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanFinding {
    /// `missing_views`, `fewer_views_than_expected`, `more_views_than_expected`, `duplicate_angles`, `mixed_revisions`,
    /// `mixed_sizes`, `mixed_cameras`, `failed_views`, `same_pictures`, or `outliers`.
    pub code: String,
    /// What it is, in which views, and what to do.
    pub detail: String,
    /// Names of the views concerned.
    pub views: Vec<String>,
}

/// URLs of a scan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanLinks {
    /// This scan.
    #[serde(rename = "self")]
    pub this: String,
    /// Its stacks.
    pub stacks: String,
    /// The table of views as CSV.
    pub views_csv: String,
    /// The bundle for a reconstruction program; add `?layout=`.
    pub bundle: String,
    /// `POST` a zip with all views here.
    pub archive: String,
    /// `POST` here to fuse every view again.
    pub rerun: String,
    /// The profile of its rig and lens.
    pub profile: String,
}

impl ScanWithViews {
    /// The view of a scan and its table. Comparing the views takes the square of their number, so another thread does
    /// it.
    ///
    /// # Errors
    /// When that thread panics.
    pub async fn tabulated(scan: Scan, views: Vec<View>) -> ApiResult<Self> {
        background::blocking(move || Self::of(scan, &views)).await
    }

    fn of(scan: Scan, views: &[View]) -> Self {
        let found = outliers(&views.iter().map(View::measurements).collect::<Vec<_>>());
        let angles: Vec<ViewAngles> = views.iter().filter_map(View::angles).collect();
        let missing = missing_views(&angles);
        let mut of_view: HashMap<usize, Vec<ViewOutlier>> = HashMap::new();
        found.iter().for_each(|outlier| of_view.entry(outlier.view).or_default().push(ViewOutlier::of(outlier)));
        let outliers = |at: usize| of_view.get(&at).cloned().unwrap_or_default();
        let rows: Vec<ScanView> = views.iter().enumerate().map(|(at, view)| row(view, outliers(at))).collect();
        let this = url(&scan.name);
        let links = ScanLinks {
            stacks: link!("/v1/stacks?scan={}", scan.name),
            views_csv: format!("{this}/views.csv"),
            bundle: format!("{this}/bundle"),
            archive: format!("{this}/archive"),
            rerun: format!("{this}/rerun"),
            profile: link!("/v1/profiles/{}/{}", scan.input.rig, scan.input.lens),
            this,
        };
        let summary = summary(scan.input.expected_views, views);
        let findings = findings(&summary, views, &rows, &missing);
        Self { scan, summary, views: rows, missing, findings, links }
    }
}

fn row(view: &View, outliers: Vec<ViewOutlier>) -> ScanView {
    let ViewStack { state, progress, error, label, pan_deg, tilt_deg, profile_revision, result, .. } = &view.stack;
    let measured = view.measurements();
    let metrics = result.as_ref().map(|result| &result.metrics);
    let mask = metrics.and_then(|metrics| metrics.mask.as_ref());
    let warnings = metrics.map(|metrics| {
        let serious =
            metrics.findings.iter().filter(|f| f.severity == pinstack_science::types::metrics::Severity::Warning);
        serious.map(|finding| finding.code.to_string()).collect()
    });
    let stack = url_of(JobKind::Stack, view.stack.id);
    let least = if outliers.is_empty() { Verdict::Use } else { Verdict::Look };
    let is_fused = *state == JobState::Succeeded;
    ScanView {
        verdict: is_fused.then(|| verdict::verdict(&view.stack.warnings).max(least)),
        name: view.stem.clone(),
        label: label.clone(),
        pan_deg: *pan_deg,
        tilt_deg: *tilt_deg,
        state: *state,
        progress: if state.is_final() { 1.0 } else { progress.fraction },
        error: error.as_ref().map(|fault| problem::problem(fault, Some(stack.clone()))),
        stack,
        profile_revision: *profile_revision,
        image_size_px: result.as_ref().map(|result| [result.image_info.width, result.image_info.height]),
        sharpness: measured.sharpness,
        mask_area: measured.mask_area,
        residual_px: measured.residual_px,
        mean_level: measured.mean_level,
        unfocused_fraction: metrics.and_then(|metrics| metrics.focus.unfocused_fraction),
        border_contact: mask.map(|mask| mask.border_contact_fraction),
        findings: warnings.unwrap_or_default(),
        outliers,
        replaced: view.others.iter().map(|id| url_of(JobKind::Stack, *id)).collect(),
    }
}

impl ViewOutlier {
    fn of(outlier: &Outlier) -> Self {
        let &Outlier { kind, value, expected, .. } = outlier;
        let detail = match kind {
            OutlierKind::Sharpness => format!(
                "the image is less sharp than its neighbours (gradient energy {value:.0}, neighbours {expected:.0}): look \
                 for vibration, a wrong focus range, or fog on the lens, and take the view again"
            ),
            OutlierKind::MaskArea => format!(
                "the object covers {:.2} % of the image, in the neighbouring views {:.2} %: look at the mask; the back \
                 light may have failed, or the object moved",
                100.0 * value,
                100.0 * expected
            ),
            OutlierKind::Residual => format!(
                "the slices fit one another within {value:.2} px, in the neighbouring views within {expected:.2} px: the \
                 object or the camera moved during the capture, or the rail missed a step"
            ),
            OutlierKind::Exposure => format!(
                "the object has a mean grey level of {value:.0}, in the neighbouring views {expected:.0}: the light or \
                 the exposure changed"
            ),
        };
        Self { kind, value, expected, detail }
    }
}

fn summary(expected: Option<u32>, views: &[View]) -> ScanSummary {
    let mut summary = ScanSummary { expected, ..ScanSummary::default() };
    for view in views {
        summary.views += 1;
        summary.replaced += u32::try_from(view.others.len()).unwrap_or(u32::MAX);
        *match view.stack.state {
            JobState::Queued => &mut summary.queued,
            JobState::Running => &mut summary.running,
            JobState::Succeeded => &mut summary.succeeded,
            JobState::Failed | JobState::Cancelled => &mut summary.failed,
        } += 1;
    }
    summary
}

/// Names for a sentence: the first five, and the number of the others.
pub fn listed(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown = names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

/// The value that occurs most often; of equally frequent ones the first.
pub fn most_common<T: Eq + Hash + Copy>(values: impl Iterator<Item = T>) -> Option<T> {
    let mut counts: HashMap<T, (usize, usize)> = HashMap::new();
    for (at, value) in values.enumerate() {
        counts.entry(value).or_insert((0, at)).0 += 1;
    }
    counts.into_iter().max_by_key(|(_, (count, first))| (*count, usize::MAX - first)).map(|(value, _)| value)
}
