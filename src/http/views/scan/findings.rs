//! What is conspicuous about a scan as a whole, as sentences with what to do.

use super::{ScanFinding, ScanSummary, ScanView, listed, most_common};
use crate::{
    contract::JobState,
    http::scans::{camera::ViewCamera, same_pictures, table::View},
};
use pinstack_science::types::view::ViewAngles;

/// The findings of a scan: failed and missing views, views that occur twice, views of another camera, outliers.
pub(super) fn findings(
    summary: &ScanSummary,
    views: &[View],
    rows: &[ScanView],
    missing: &[ViewAngles],
) -> Vec<ScanFinding> {
    let mut found = Vec::new();
    let named = |is_one: &dyn Fn(&ScanView) -> bool| -> Vec<String> {
        rows.iter().filter(|row| is_one(row)).map(|row| row.name.clone()).collect()
    };
    let failed = named(&|row| matches!(row.state, JobState::Failed | JobState::Cancelled));
    if !failed.is_empty() {
        let detail = format!("no result for {}: see the error of each, then send it or fuse it again", listed(&failed));
        found.push(ScanFinding::of("failed_views", detail, failed));
    }
    if !missing.is_empty() {
        let names: Vec<String> = missing.iter().map(ViewAngles::file_stem).collect();
        let detail = format!("no view at {}: take it, or check the angles of the others", listed(&names));
        found.push(ScanFinding::of("missing_views", detail, names));
    }
    match summary.expected {
        Some(expected) if summary.views < expected => {
            let detail = format!("{} of {expected} expected views have been sent", summary.views);
            found.push(ScanFinding::of("fewer_views_than_expected", detail, Vec::new()));
        }
        Some(expected) if summary.views > expected => {
            let detail = format!(
                "{} views, {expected} were expected: look for views that were sent twice under different labels or angles",
                summary.views
            );
            found.push(ScanFinding::of("more_views_than_expected", detail, Vec::new()));
        }
        _ => {}
    }
    let same = |a: &ScanView, b: &ScanView| a.pan_deg.is_some() && (a.pan_deg, a.tilt_deg) == (b.pan_deg, b.tilt_deg);
    let twice: Vec<String> = rows
        .windows(2)
        .filter(|pair| same(&pair[0], &pair[1]))
        .flat_map(|pair| [pair[0].name.clone(), pair[1].name.clone()])
        .collect();
    if !twice.is_empty() {
        let detail =
            format!("{} have the same pan and tilt under different labels: delete one, or correct it", listed(&twice));
        found.push(ScanFinding::of("duplicate_angles", detail, twice));
    }
    found.extend(mixed_cameras(views, rows));
    let copies = same_pictures::groups(views.iter().map(|view| (view.stem.as_str(), &view.stack.pictures[..])));
    if !copies.is_empty() {
        let detail = format!(
            "the same pictures are in several views, {}: was a folder renamed, or sent under another label or angle? \
             Delete the views that are wrong",
            listed(&copies.iter().map(|group| format!("({})", listed(group))).collect::<Vec<_>>())
        );
        let mut names = copies.concat();
        names.sort_unstable();
        names.dedup();
        found.push(ScanFinding::of("same_pictures", detail, names));
    }
    let differ = named(&|row| !row.outliers.is_empty());
    if !differ.is_empty() {
        let detail = format!("views that differ from their neighbours: {}; see the outliers of each", listed(&differ));
        found.push(ScanFinding::of("outliers", detail, differ));
    }
    found
}

impl ScanFinding {
    fn of(code: &str, detail: String, views: Vec<String>) -> Self {
        Self { code: code.to_owned(), detail, views }
    }
}

/// Views that do not share the camera of most: another profile revision, size, crop or principal distance.
fn mixed_cameras(views: &[View], rows: &[ScanView]) -> Vec<ScanFinding> {
    let mut found = Vec::new();
    let usual = most_common(views.iter().map(|view| view.stack.profile_digest.as_str()));
    let other_profile: Vec<String> = views
        .iter()
        .filter(|view| Some(view.stack.profile_digest.as_str()) != usual)
        .map(|view| view.stem.clone())
        .collect();
    if !other_profile.is_empty() {
        let detail = format!(
            "fused with another profile revision than most: {}; the views have no common camera: fuse the scan again",
            listed(&other_profile)
        );
        found.push(ScanFinding::of("mixed_revisions", detail, other_profile.clone()));
    }
    let usual = most_common(rows.iter().filter_map(|row| row.image_size_px));
    let other_size: Vec<String> = rows
        .iter()
        .filter(|row| row.image_size_px.is_some() && row.image_size_px != usual)
        .map(|row| row.name.clone())
        .collect();
    if !other_size.is_empty() {
        let detail =
            format!("another size than most: {}; fuse these views again with the same crop", listed(&other_size));
        found.push(ScanFinding::of("mixed_sizes", detail, other_size.clone()));
    }
    let told: Vec<String> = other_profile.into_iter().chain(other_size).collect();
    let (other_camera, differences): (Vec<String>, Vec<String>) =
        other_cameras(views).into_iter().filter(|(name, _)| !told.contains(name)).unzip();
    if let Some(difference) = differences.first() {
        let detail = format!(
            "another camera than most ({difference}): {}; the views have no common camera: fuse the scan again with one \
             crop and profile",
            listed(&other_camera)
        );
        found.push(ScanFinding::of("mixed_cameras", detail, other_camera));
    }
    found
}

/// The views whose camera is not that of most, each with its difference.
fn other_cameras(views: &[View]) -> Vec<(String, String)> {
    let cameras: Vec<(&View, ViewCamera<'_>)> =
        views.iter().filter_map(|view| Some((view, ViewCamera::of(view, view.stack.result.as_ref()?)))).collect();
    let Some(usual) = most_common(cameras.iter().map(|(_, camera)| *camera)) else { return Vec::new() };
    let differ = cameras.iter().filter_map(|(view, camera)| Some((view.stem.clone(), camera.difference(&usual)?)));
    differ.collect()
}
